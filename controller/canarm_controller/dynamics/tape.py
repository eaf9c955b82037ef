"""A tape of arithmetic: a formula that runs once on terms instead of numbers records its operations.

Owns the terms, the folding of constants, and which terms a result needs. The meaning of formulas, and the execution of
operations, must not enter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias, Union


class Kind(Enum):
    """The operation that makes a term."""

    INPUT = auto()
    ADD = auto()
    SUBTRACT = auto()
    MULTIPLY = auto()
    DIVIDE = auto()
    NEGATE = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    TANH = auto()


Value: TypeAlias = Union["Term", float]
"""The operands of formulas. Values known while recording stay floats and never reach the tape."""


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One result on a tape. Operators record further ones, except where 0, 1 or a sign make them needless.

    0·x counts as 0, which holds because inputs are finite (checked before a program runs).
    """

    tape: "Tape"
    number: int
    kind: Kind
    operands: tuple[Value, ...]

    def __neg__(self) -> Value:
        if self.kind is Kind.NEGATE:
            return self.operands[0]
        if self.kind is Kind.SUBTRACT:
            return self.tape.record(Kind.SUBTRACT, self.operands[1], self.operands[0])
        if self.kind is Kind.MULTIPLY and isinstance(self.operands[0], float):
            return self.tape.record(Kind.MULTIPLY, -self.operands[0], self.operands[1])
        return self.tape.record(Kind.NEGATE, self)

    def __add__(self, other: Value) -> Value:
        if other == 0.0:
            return self
        if isinstance(other, Term):
            if other.kind is Kind.NEGATE:
                return self - other.operands[0]
            if self.kind is Kind.NEGATE:
                return other - self.operands[0]
            if other.number < self.number:
                return self.tape.record(Kind.ADD, other, self)
        return self.tape.record(Kind.ADD, self, other)

    def __radd__(self, other: float) -> Value:
        return self + other

    def __sub__(self, other: Value) -> Value:
        if other == 0.0:
            return self
        if isinstance(other, Term) and other.kind is Kind.NEGATE:
            return self + other.operands[0]
        return self.tape.record(Kind.SUBTRACT, self, other)

    def __rsub__(self, other: float) -> Value:
        return -self if other == 0.0 else self.tape.record(Kind.SUBTRACT, other, self)

    def __mul__(self, other: Value) -> Value:
        if isinstance(other, Term):
            if self.kind is Kind.NEGATE:
                return -(self.operands[0] * other)
            if other.kind is Kind.NEGATE:
                return -(self * other.operands[0])
            first, second = (self, other) if self.number <= other.number else (other, self)
            return self.tape.record(Kind.MULTIPLY, first, second)
        if other == 0.0:
            return 0.0
        if other == 1.0:
            return self
        if other == -1.0:
            return -self
        if self.kind is Kind.NEGATE:
            return self.operands[0] * -other
        if self.kind is Kind.MULTIPLY and isinstance(self.operands[0], float):
            return self.operands[1] * (self.operands[0] * other)
        return self.tape.record(Kind.MULTIPLY, other, self)

    def __rmul__(self, other: float) -> Value:
        return self * other

    def __truediv__(self, other: Value) -> Value:
        return self.tape.record(Kind.DIVIDE, self, other)

    def __rtruediv__(self, other: float) -> Value:
        return self.tape.record(Kind.DIVIDE, other, self)


class Tape:
    """The terms recorded so far, in an order in which they can be computed; equal operations are recorded once."""

    def __init__(self) -> None:
        self._terms: list[Term] = []
        self._known: dict[tuple[Kind, tuple[Value, ...]], Term] = {}

    def inputs(self, count: int) -> tuple[Term, ...]:
        """`count` new inputs."""
        new = tuple(Term(self, len(self._terms) + i, Kind.INPUT, ()) for i in range(count))
        self._terms.extend(new)
        return new

    def record(self, kind: Kind, *operands: Value) -> Term:
        """The term of an operation, as it stands: no folding."""
        key = kind, operands
        if key not in self._known:
            self._known[key] = Term(self, len(self._terms), kind, operands)
            self._terms.append(self._known[key])
        return self._known[key]


def cos_sin(angle: Value) -> tuple[Value, Value]:
    """Cosine and sine of an angle in rad."""
    if isinstance(angle, Term):
        return angle.tape.record(Kind.COS, angle), angle.tape.record(Kind.SIN, angle)
    return math.cos(angle), math.sin(angle)


def cos_sin_by_tangent(angle: Value) -> tuple[Value, Value]:
    """Cosine and sine from the tangent t of half the angle: u = 2/(1 + t²), cos = u − 1, sin = t·u.

    One transcendental function instead of two, good to 3e-16 everywhere (no float is an odd multiple of π). With the
    vector instructions that numpy uses for tan, and not for sin and cos, this takes a quarter of the time.
    """
    if not isinstance(angle, Term):
        return cos_sin(angle)
    half = 0.5 * angle
    assert isinstance(half, Term)
    tangent = angle.tape.record(Kind.TAN, half)
    scale = 2.0 / (1.0 + tangent * tangent)
    return scale + -1.0, tangent * scale


def tanh(value: Value) -> Value:
    """Hyperbolic tangent."""
    return value.tape.record(Kind.TANH, value) if isinstance(value, Term) else math.tanh(value)


@dataclass(frozen=True, slots=True)
class Program:
    """A computation: named groups of inputs, and results in terms of them."""

    inputs: dict[str, tuple[Term, ...]]
    results: tuple[Value, ...]

    def needed(self) -> list[Term]:
        """The operations on which the results depend, in order, inputs left out."""
        found: dict[Term, None] = {}
        waiting = [value for value in self.results if isinstance(value, Term)]
        while waiting:
            term = waiting.pop()
            if term not in found:
                found[term] = None
                waiting.extend(operand for operand in term.operands if isinstance(operand, Term))
        return sorted((term for term in found if term.kind is not Kind.INPUT), key=lambda term: term.number)


def uses(terms: Sequence[Term], results: Sequence[Value]) -> dict[Term, int]:
    """How often each term is an operand of `terms` or one of the `results`."""
    counts: dict[Term, int] = {}
    for value in [*(operand for term in terms for operand in term.operands), *results]:
        if isinstance(value, Term):
            counts[value] = counts.get(value, 0) + 1
    return counts
