"""Virtual time as nodes count it: integers in ns."""

NEVER = 1 << 62
MICROSECOND, MILLISECOND = 1_000, 1_000_000
INHIBIT_UNIT = 100 * MICROSECOND
"""Inhibit times of PDOs and EMCY count in 100 µs (CiA 301, 7.5.2.18 and 7.5.2.37)."""
