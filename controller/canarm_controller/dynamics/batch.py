"""A program carried out by numpy on many states at once, for tables.

Owns the workspace and the assignment of results to its rows. Equations must not enter.

States are the last axis, so that operations run over contiguous memory, and a block of states passes the whole program
before the next, so that intermediate results stay in the cache. Every operation writes into a row of a workspace that
is allocated once; a row is reused after the last use of its result.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..errors import DynamicsError
from .chain import Floats
from .checks import check_samples
from .tape import Kind, Program, Term, Value

BLOCK = 4096
"""States per block: one table of 4096. Smaller blocks were measured to lose more by calls than they gain from the
cache: a row is 32 KiB, a workspace has 7 rows (two planar joints) to about 50 (six joints, nothing zero)."""

_UFUNCS: dict[Kind, np.ufunc] = {
    Kind.ADD: np.add,
    Kind.SUBTRACT: np.subtract,
    Kind.MULTIPLY: np.multiply,
    Kind.DIVIDE: np.divide,
    Kind.NEGATE: np.negative,
    Kind.SIN: np.sin,
    Kind.COS: np.cos,
    Kind.TAN: np.tan,
    Kind.TANH: np.tanh,
}


class BatchProgram:
    """A program with its workspace. Not to be called by two threads at once: they would share the workspace."""

    def __init__(self, program: Program, joint_names: Sequence[str]) -> None:
        self._joint_names = tuple(joint_names)
        self._groups = tuple(program.inputs)
        places = _Places(program)
        self._steps = [places.step(term) for term in places.needed]
        self._results = [places.of(value) for value in program.results]
        self._constants = [np.array(constant) for constant in places.constants]
        self._workspace = np.empty((places.row_count, BLOCK))

    def __call__(self, *states: Floats, out: Floats | None = None) -> Floats:
        """Results for arrays (joints, samples), one for every group of inputs, as an array (results, samples).

        `out`, of that shape, takes the results and is returned; without it a new array is. Raises `DynamicsError` for
        another shape, and for a value that is not finite; names the sample and joint.
        """
        states = tuple(np.ascontiguousarray(state, dtype=np.float64) for state in states)
        check_samples(self._joint_names, **dict(zip(self._groups, states, strict=True)))
        count = states[0].shape[1]
        shape = len(self._results), count
        if out is None:
            out = np.empty(shape)
        elif out.shape != shape:
            raise DynamicsError(f"out has shape {out.shape}; must be {shape}")
        for start in range(0, count, BLOCK):
            stop = min(start + BLOCK, count)
            self._run([row[start:stop] for state in states for row in state], out[:, start:stop])
        return out

    def _run(self, inputs: list[Floats], out: Floats) -> None:
        rows: list[Floats] = [*inputs, *self._workspace[:, : out.shape[1]], *self._constants]
        for ufunc, first, second, target in self._steps:
            if second is None:
                ufunc(rows[first], rows[target])
            else:
                ufunc(rows[first], rows[second], rows[target])
        for row, place in zip(out, self._results, strict=True):
            row[:] = rows[place]


class _Places:
    """The place of every value of a program: inputs first, then rows of the workspace, then constants."""

    def __init__(self, program: Program) -> None:
        self.needed = program.needed()
        inputs = [term for group in program.inputs.values() for term in group]
        self._place: dict[Value, int] = {term: place for place, term in enumerate(inputs)}
        last_use = {
            operand: step
            for step, term in enumerate(self.needed)
            for operand in term.operands
            if isinstance(operand, Term)
        }
        kept = {value for value in program.results if isinstance(value, Term)} | set(inputs)
        free: list[int] = []
        self.row_count = 0
        for step, term in enumerate(self.needed):
            operands = {operand for operand in term.operands if isinstance(operand, Term)} - kept
            free += [self._place[operand] for operand in operands if last_use[operand] == step]
            if not free:
                free.append(len(inputs) + self.row_count)
                self.row_count += 1
            self._place[term] = free.pop()
        values = [operand for term in self.needed for operand in term.operands] + list(program.results)
        self.constants = list(dict.fromkeys(float(value) for value in values if not isinstance(value, Term)))
        first = len(inputs) + self.row_count
        self._place.update({constant: first + i for i, constant in enumerate(self.constants)})

    def of(self, value: Value) -> int:
        """Index of a value in the list that `BatchProgram` works on."""
        return self._place[value]

    def step(self, term: Term) -> tuple[Callable[..., object], int, int | None, int]:
        """An operation as ufunc, first and second operand, and target."""
        first, *rest = (self._place[operand] for operand in term.operands)
        return _UFUNCS[term.kind], first, rest[0] if rest else None, self._place[term]
