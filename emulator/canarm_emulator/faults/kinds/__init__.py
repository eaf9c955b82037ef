"""The faults, one file per family. A file in this folder is found by itself; `declaration.py` says what a fault is."""
