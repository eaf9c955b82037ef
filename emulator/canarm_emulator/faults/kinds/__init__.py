"""The faults, a file a family. A file put here is found by itself; `declaration.py` says what a fault is."""
