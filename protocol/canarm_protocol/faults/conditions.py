"""Conditions over signals, such as `joint2.angle_deg > 30 and time_s > 1`: parsed once, evaluated every cycle.

Comparisons of signals and numbers, joined by `and`, `or`, `not`, with `abs()` and the four arithmetic operations. The
caller provides the names and values of the signals.
"""

import ast
import itertools
import math
import operator
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence

from ..cell.cell_messages import nearest
from ..errors import FaultError
from ..shown import quoted

Value = Callable[[Mapping[str, float]], float]

LONGEST_CONDITION = 400
DEEPEST = 25
"""Most nested levels of brackets and operators; no sensible condition has half as many."""
LARGEST = 1e300
"""Largest number in a condition: a whole number could otherwise exceed the range of floats."""
_COMPARISONS: dict[type[ast.cmpop], Callable[[float, float], bool]] = {
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_OPERATIONS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: lambda left, right: left / right if right else float("nan"),
}
_ABS = "abs"
_EXPECTED = "a condition compares signals with numbers, such as joint2.angle_deg > 30"


class Condition:
    """A parsed condition. `text` is what was given, `signals` are the names that it reads."""

    def __init__(self, text: str, known: Collection[str]) -> None:
        """Parse `text`, in which the names of signals are among `known`. Raises `FaultError`."""
        self.text = text
        self.signals: set[str] = set()
        self._known = known
        if len(text) > LONGEST_CONDITION:
            raise FaultError(f"a condition of {len(text)} characters: must have at most {LONGEST_CONDITION}")
        self._source = text.strip()
        try:
            with warnings.catch_warnings():  # Python warns about odd text such as `1and`, which is the user's
                warnings.simplefilter("ignore", SyntaxWarning)
                body = ast.parse(self._source, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise FaultError(f"condition {quoted(text)}: cannot be read; {_EXPECTED}") from None
        self._check_depth(body)
        self._is_true = self._truth(body)

    def holds(self, values: Mapping[str, float]) -> bool:
        """Whether it is true for these values of its signals."""
        return bool(self._is_true(values))

    def _check_depth(self, body: ast.expr) -> None:
        """Bounds the recursion of what follows, `ast.unparse` included."""
        level: list[ast.AST] = [body]
        for _ in range(DEEPEST):
            level = [child for node in level for child in ast.iter_child_nodes(node)]
            if not level:
                return
        raise FaultError(f"condition {quoted(self.text)}: nested too deep; at most {DEEPEST} levels")

    def _truth(self, node: ast.expr) -> Value:
        if isinstance(node, ast.BoolOp):
            parts = [self._truth(value) for value in node.values]
            join = all if isinstance(node.op, ast.And) else any
            return lambda values: join(part(values) for part in parts)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            inverted = self._truth(node.operand)
            return lambda values: not inverted(values)
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            numbers = [self._number(each) for each in sides]
            compare = [_COMPARISONS.get(type(each)) for each in node.ops]
            known = [each for each in compare if each is not None]
            if len(known) == len(compare):
                self._check_variable(node, sides, numbers)
                pairs = list(zip(known, numbers, numbers[1:], strict=False))
                return lambda values: all(test(left(values), right(values)) for test, left, right in pairs)
        raise self._unreadable(node)

    def _number(self, node: ast.expr) -> Value:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            if abs(node.value) > LARGEST:
                raise FaultError(
                    f"condition {quoted(self.text)}: {quoted(self._given(node))} is too large; at most {LARGEST:g}"
                )
            constant = float(node.value)
            return lambda values: constant
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            negated = self._number(node.operand)
            return lambda values: -negated(values)
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
            combine, left, right = _OPERATIONS[type(node.op)], self._number(node.left), self._number(node.right)
            if isinstance(node.op, ast.Div) and _is_constant(node.right) and not right({}):
                raise FaultError(
                    f"condition {quoted(self.text)}: {quoted(self._given(node))} divides by zero, and has no value"
                )
            return lambda values: combine(left(values), right(values))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == _ABS and len(node.args) == 1 and not node.keywords:
            inner = self._number(node.args[0])
            return lambda values: abs(inner(values))
        if isinstance(node, ast.Name | ast.Attribute):
            name = ast.unparse(node)
            if name not in self._known:
                raise FaultError(
                    f"condition {quoted(self.text)}: no signal {quoted(name)}{nearest(name, sorted(self._known))}"
                )
            self.signals.add(name)
            return lambda values: values[name]
        raise self._unreadable(node)

    def _check_variable(self, node: ast.Compare, sides: Sequence[ast.expr], numbers: Sequence[Value]) -> None:
        """Refuse a comparison of two constants, or with a number that is not finite."""
        constant = [_is_constant(each) for each in sides]
        if any(pair == (True, True) for pair in itertools.pairwise(constant)):
            raise FaultError(
                f"condition {quoted(self.text)}: {quoted(self._given(node))} compares numbers that never change; "
                f"{_EXPECTED}"
            )
        for is_constant, side, number in zip(constant, sides, numbers, strict=True):
            if is_constant and not math.isfinite(number({})):
                raise FaultError(f"condition {quoted(self.text)}: {quoted(self._given(side))} is no finite number")

    def _unreadable(self, node: ast.expr) -> FaultError:
        return FaultError(f"condition {quoted(self.text)}: {quoted(self._given(node))} cannot be used; {_EXPECTED}")

    def _given(self, node: ast.expr) -> str:
        """A part of the condition as it was written."""
        return ast.get_source_segment(self._source, node) or ast.unparse(node)


def _is_constant(node: ast.expr) -> bool:
    """Whether it reads no signal."""
    return not any(isinstance(each, ast.Name) and each.id != _ABS for each in ast.walk(node))
