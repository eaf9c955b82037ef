"""Any chain, linear in its base parameters: torque, gradient and accelerations as programs of these parameters.

Finds which of the ten inertial parameters of each link can be identified from the joints' motion, together with
friction and rotors, and their nominal values. A law finds the true values.

`newton_euler.lumped_inertias` has already moved three of the ten to the link before. Of the rest, parameters without
effect at any joint are dropped, and those that always occur together are merged: on the tape, sums of zeros vanish and
equal sums are one term.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from .chain import Chain
from .newton_euler import (
    DriveTerms,
    Inertia,
    Motion,
    acceleration_terms,
    lumped_inertias,
    motions,
    sweeps,
    torques_of,
    turns_of,
)
from .tape import Program, Tape, Term, Value, tanh

ENTRIES = {(0, 0): "xx", (1, 1): "yy", (0, 1): "xy", (0, 2): "xz", (1, 2): "yz", (0, 3): "mx", (1, 3): "my"}
"""Elements of J_i, on its own joint's axis, and their names: second moments in kg·m², first moments in kg·m."""
NEGLIGIBLE = 1e-12
"""A parameter below this share of the largest of its kind is rounding, and counts as 0."""


@dataclass(frozen=True, slots=True)
class BaseParameter:
    """One parameter: where it stands (joint from 0, and an element of `ENTRIES` or a term of the drive), and its value.

    `kind` is "xx" ... "my", "rotor", "viscous" or "coulomb"; SI units.
    """

    joint: int
    kind: str
    nominal: float


@dataclass(frozen=True, slots=True)
class LinearForm:
    """τ = Y(q, q̇, q̇_r, q̈_r)·p as programs; the group "p" has one number per parameter.

    - `torque`: Y·p of q, q̇, q̇_r, q̈_r, the speeds whose sign Coulomb friction takes, and p;
    - `gradient`: Yᵀs of the same without p, and s, one number per joint;
    - `acceleration`: as `newton_euler.acceleration_program`, of q, q̇, τ and p.
    """

    parameters: tuple[BaseParameter, ...]
    torque: Program
    gradient: Program
    acceleration: Program


def linear_form(chain: Chain, drive: DriveTerms) -> LinearForm:
    """The programs of one chain with its drives, whose numbers must be floats here."""
    found = _gradient(chain, drive)
    parameters = tuple(parameter for parameter, _ in found[1])
    gradient = Program(found[0], tuple(term for _, term in found[1]))
    return LinearForm(parameters, _torque(chain, drive, parameters), gradient, _acceleration(chain, drive, parameters))


def _gradient(chain: Chain, drive: DriveTerms) -> tuple[dict[str, tuple[Term, ...]], list[tuple[BaseParameter, Term]]]:
    """Yᵀs by virtual power: s·τ = Σ Tr(W·J·Sᵀ), so that the element of J at (a, b) has (SᵀW + WᵀS) at (a, b)."""
    tape, count = Tape(), len(chain.links)
    q, qd, qd_r, qdd_r, sliding, s = (tape.inputs(count) for _ in range(6))
    turns = turns_of(chain, q)
    moved, swept = motions(chain, turns, qd, qdd_r, chain.gravity_m_s2, qd_r), sweeps(chain, turns, s)
    inertias = [inertia.tolist() for inertia in lumped_inertias(chain)]
    shown: dict[Term, BaseParameter] = {}

    def note(joint: int, kind: str, term: Value, nominal: float) -> None:
        if isinstance(term, Term):
            before = shown.get(term)
            shown[term] = BaseParameter(
                before.joint if before else joint,
                before.kind if before else kind,
                nominal + (before.nominal if before else 0.0),
            )

    for i in range(count):
        for (a, b), kind in ENTRIES.items():
            note(i, kind, _power(swept[i], moved[i], a, b), inertias[i][a][b])
    for i in range(count):
        note(i, "rotor", s[i] * qdd_r[i], float(drive.rotor_inertia_kg_m2[i]))  # type: ignore[arg-type]
        note(i, "viscous", s[i] * qd_r[i], float(drive.viscous_nm_s[i]))  # type: ignore[arg-type]
        slides = tanh(sliding[i] * (1.0 / drive.smoothing_rad_s))
        note(i, "coulomb", s[i] * slides, float(drive.coulomb_nm[i]))  # type: ignore[arg-type]
    largest: dict[bool, float] = {}
    for parameter in shown.values():
        is_first_moment = parameter.kind in ("mx", "my")
        largest[is_first_moment] = max(largest.get(is_first_moment, 0.0), abs(parameter.nominal))
    kept = [
        (parameter, term)
        for term, parameter in shown.items()
        if abs(parameter.nominal) > NEGLIGIBLE * largest[parameter.kind in ("mx", "my")]
    ]
    return {"q": q, "qd": qd, "qd_r": qd_r, "qdd_r": qdd_r, "sliding": sliding, "s": s}, kept


def _power(swept: Motion, moved: Motion, a: int, b: int) -> Value:
    total: Value = 0.0
    for sweep, motion in zip(swept, moved, strict=True):
        total = total + sweep[a] * motion[b]
        if a != b:
            total = total + sweep[b] * motion[a]
    return total


def _torque(chain: Chain, drive: DriveTerms, parameters: Sequence[BaseParameter]) -> Program:
    tape, count = Tape(), len(chain.links)
    q, qd, qd_r, qdd_r, sliding = (tape.inputs(count) for _ in range(5))
    p = tape.inputs(len(parameters))
    inertias, drives = _placed(count, drive, parameters, p)
    turns = turns_of(chain, q)
    links = torques_of(chain, turns, motions(chain, turns, qd, qdd_r, chain.gravity_m_s2, qd_r), inertias)
    torques = [links[i] + drives.torque(i, qd_r[i], qdd_r[i], sliding[i]) for i in range(count)]
    return Program({"q": q, "qd": qd, "qd_r": qd_r, "qdd_r": qdd_r, "sliding": sliding, "p": p}, tuple(torques))


def _acceleration(chain: Chain, drive: DriveTerms, parameters: Sequence[BaseParameter]) -> Program:
    tape, count = Tape(), len(chain.links)
    q, qd, torque = (tape.inputs(count) for _ in range(3))
    p = tape.inputs(len(parameters))
    inertias, drives = _placed(count, drive, parameters, p)
    results = acceleration_terms(chain, q, qd, torque, inertias, drives)
    return Program({"q": q, "qd": qd, "torque_nm": torque, "p": p}, results)


def _placed(
    count: int, drive: DriveTerms, parameters: Sequence[BaseParameter], p: Sequence[Value]
) -> tuple[list[Inertia], DriveTerms]:
    """J_i and the drives, with each parameter where it stands and zero elsewhere."""
    inertias: list[list[list[Value]]] = [[[0.0] * 4 for _ in range(4)] for _ in range(count)]
    drives: dict[str, list[Value]] = {kind: [0.0] * count for kind in ("rotor", "viscous", "coulomb")}
    entry_of = {kind: entry for entry, kind in ENTRIES.items()}
    for parameter, value in zip(parameters, p, strict=True):
        if parameter.kind in drives:
            drives[parameter.kind][parameter.joint] = value
        else:
            a, b = entry_of[parameter.kind]
            inertias[parameter.joint][a][b] = inertias[parameter.joint][b][a] = value
    placed: list[Inertia] = [*inertias]
    return placed, DriveTerms(drives["rotor"], drives["viscous"], drives["coulomb"], drive.smoothing_rad_s)
