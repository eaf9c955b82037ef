"""Work on many processes: a pool that survives what happens to its workers, copies of a process, a bar of progress."""
