"""Studies: many runs with settings from a grid or a sample, their table, and the page that shows it."""
