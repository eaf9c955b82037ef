"""Which numbers an option takes: validators for cyclopts."""

from .usage import LARGEST_SEED

LONGEST_RUN_S = 1e9
"""Thirty years: for a run until Ctrl-C. Its cycles can still be counted and its end waited for."""


def positive(type_: object, value: float | None) -> None:
    """Refuse a number of seconds that is not above 0, or absurd."""
    if value is not None and not 0.0 < value <= LONGEST_RUN_S:
        raise ValueError(f"must be a number of seconds above 0 and at most {LONGEST_RUN_S:g} s.")


def not_negative(type_: object, value: int | None) -> None:
    """Refuse a number below 0."""
    if value is not None and value < 0:
        raise ValueError("must be 0 or more.")


def possible_seed(type_: object, value: int | None) -> None:
    """Refuse a seed that is negative, or too large to be recorded everywhere."""
    not_negative(type_, value)
    if value is not None and value > LARGEST_SEED:
        raise ValueError(f"must be at most {LARGEST_SEED}.")


def at_least_one(type_: object, value: int | None) -> None:
    """Refuse a number below 1."""
    if value is not None and value < 1:
        raise ValueError("must be 1 or more.")
