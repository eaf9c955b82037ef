"""The Apple II's peripheral cards as registers, and what each of them offers as a CiA 401 I/O module."""
