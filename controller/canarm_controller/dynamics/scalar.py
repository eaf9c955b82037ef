"""A program as a Python function of plain floats, for one state in the control cycle.

Owns the translation to source text and its compilation. Equations and numpy must not enter.

Why text: in Python, a loop over links or operations costs several times as much as the arithmetic itself (every index,
call and branch costs as much as a product), and a cycle has 2.5 ms for everything; straight-line code is only
arithmetic. Why `exec` is safe: the text consists of operators, numbered names (`q0`, `t7`) and the `repr` of floats. No
name or string of a cell gets into it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from .checks import check_state
from .tape import Kind, Program, Term, Value, uses

ScalarFunction: TypeAlias = Callable[..., tuple[float, ...]]

LINE_LENGTH = 100
"""A result that is used once is inlined, up to this line length."""

_INFIX = {Kind.ADD: "+", Kind.SUBTRACT: "-", Kind.MULTIPLY: "*", Kind.DIVIDE: "/"}
_PREFIX = {Kind.NEGATE: "-", Kind.SIN: "sin", Kind.COS: "cos", Kind.TAN: "tan", Kind.TANH: "tanh"}


def compile_scalar(
    program: Program, joint_names: Sequence[str], other_names: Mapping[str, Sequence[str]] | None = None
) -> ScalarFunction:
    """A function of one sequence of floats for every group of inputs that returns the results.

    A group has one float per joint, or one for each name that `other_names` has for it. The function raises
    `DynamicsError` for another length, or a value that is not finite, and names the joint. Numpy scalars work but are
    slow: give it `tolist()`.
    """
    names = dict.fromkeys(program.inputs, joint_names) | dict(other_names or {})

    def refuse(*groups: object) -> None:
        for (group, names_of), values in zip(names.items(), groups, strict=True):
            check_state(names_of, **{group: values})

    namespace: dict[str, object] = {name: getattr(math, name) for name in ("sin", "cos", "tan", "tanh")}
    namespace["refuse"] = refuse
    exec(compile(source(program), f"<program for {len(joint_names)} joints>", "exec"), namespace)
    function: ScalarFunction = namespace["evaluate"]  # type: ignore[assignment]
    return function


def source(program: Program) -> str:
    """The source text of the function."""
    names: dict[Term, str] = {}
    for group, terms in program.inputs.items():
        names.update({term: f"{group}{i}" for i, term in enumerate(terms)})
    groups = ", ".join(program.inputs)
    # x - x is 0 for every finite x and NaN otherwise: one test for all inputs. `refuse` looks closer and returns if it
    # was only the sum that overflowed.
    lines = [
        f"def evaluate({groups}):",
        "    try:",
        *(f"        [{', '.join(names[t] for t in terms)}] = {group}" for group, terms in program.inputs.items()),
        f"        total = {' + '.join(names.values())}",
        "        if total - total:",
        f"            refuse({groups})",
        "    except (TypeError, ValueError):",
        f"        refuse({groups})",
        "        raise",
        *(f"    {line}" for line in _statements(program, names)),
    ]
    return "\n".join(lines) + "\n"


def _statements(program: Program, names: dict[Term, str]) -> list[str]:
    needed = program.needed()
    counts = uses(needed, program.results)
    lines: list[str] = []

    def text(value: Value) -> str:
        return names[value] if isinstance(value, Term) else repr(float(value))

    for term in needed:
        operands = [text(operand) for operand in term.operands]
        if term.kind in _INFIX:
            formula = f" {_INFIX[term.kind]} ".join(operands)
            nested = f"({formula})"
        else:
            nested = formula = f"{_PREFIX[term.kind]}({operands[0]})"
        if counts[term] == 1 and len(nested) < LINE_LENGTH:
            names[term] = nested
        else:
            names[term] = f"t{term.number}"
            lines.append(f"{names[term]} = {formula}")
    results = ", ".join(text(value) for value in program.results)
    return [*lines, f"return ({results},)"]
