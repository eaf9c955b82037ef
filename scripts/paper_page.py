"""What docs/papers.md says: each claim of the first paper, what was measured, what differs; and when that is false."""

import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass

from paper_runs import ADAPTIVE, FIXED, PAYLOADS, Case, Outcome

from canarm_controller.reference.memory import SAMPLES, TABLE_BASE
from canarm_protocol.cell.cell_file import load_cell

PAPERS_BYTES = 0x4000 - TABLE_BASE
"""From $2000 to $3FFF."""
SAME_LSB = 0.05
"""Errors that differ by less are the same: seeds differ by 0.03."""


@dataclass(frozen=True)
class Results:
    """Every run with what came of it; the shortest period of the trapezoid, s, and what forbids a shorter one."""

    runs: Mapping[Case, Outcome]
    fastest_s: float
    limit: str

    def of(self, law: str, feedforward: str, trajectory: str, payload: str = "right") -> Outcome:
        """One run of the usual length."""
        return self.runs[Case(law, feedforward, trajectory, PAYLOADS[payload])]


@dataclass(frozen=True)
class Claim:
    """A row of the page, and whether the figures bear out what it says."""

    printed: str
    where: str
    measured: str
    differs: str
    holds: bool


def claims(results: Results) -> list[Claim]:
    """All of them, in the order of the paper."""
    return [
        _constant_speed(results),
        _smoothness(results),
        _compensation(results),
        _adaptation(results),
        _memory(results),
        _real_time(results),
        _current_instead_of_torque(results),
        _high_speed(results),
    ]


def _constant_speed(results: Results) -> Claim:
    without, with_table = (results.of(FIXED, kind, "trapezoid") for kind in ("none", "table"))
    heavy = results.of(FIXED, "table", "trapezoid", "+50 %")
    return Claim(
        "The dynamics being computed, the joints move at constant speed; the speed was very constant.",
        "III, IV",
        "Standard deviation of a joint's speed over its mean, on the constant stretches of the trapezoid, worse joint: "
        f"{_percent(with_table.ripple)} with the table, {_percent(without.ripple)} without.",
        "The paper gives no figure. Here the table makes the speed constant as long as its masses are right; with half "
        f"as much payload again it is {_percent(heavy.ripple)}. What is left, {_percent(with_table.ripple)}, is the "
        "8 bits of the sensors, which the feedback follows.",
        with_table.ripple < 0.3 * without.ripple < heavy.ripple,
    )


def _smoothness(results: Results) -> Claim:
    fixed, adaptive = (results.of(law, "table", "trapezoid") for law in (FIXED, ADAPTIVE))
    bare = results.of(ADAPTIVE, "none", "trapezoid")
    return Claim(
        "With MRAS the motion was very smooth.",
        "IV",
        "RMS acceleration where the speed should be constant, worse joint: "
        f"{fixed.roughness_rad_s2:.2f} rad/s² with fixed gains and the table, {adaptive.roughness_rad_s2:.2f} with "
        f"MRAS and the table, {bare.roughness_rad_s2:.2f} with MRAS alone. Ripple {_percent(fixed.ripple)}, "
        f"{_percent(adaptive.ripple)} and {_percent(bare.ripple)}.",
        "Smooth, but not because of MRAS: fixed gains with the same table are a little smoother, since there is "
        "nothing left to adapt to and adaptation follows the noise. The paper compares with nothing. Its arm is driven "
        "by wires; this one is stiff unless `--truth joint2.wire=1` says otherwise.",
        fixed.roughness_rad_s2 < adaptive.roughness_rad_s2 < bare.roughness_rad_s2
        and fixed.ripple < adaptive.ripple < bare.ripple,
    )


def _compensation(results: Results) -> Claim:
    rows = [
        f"{law} {results.of(law, 'none', motion).rms_lsb[0]:.2f} → {results.of(law, 'table', motion).rms_lsb[0]:.2f} "
        f"({motion})"
        for law in (FIXED, ADAPTIVE)
        for motion in ("trapezoid", "sine")
    ]
    is_better = all(
        results.of(law, "table", motion).rms_lsb[0] < 0.3 * results.of(law, "none", motion).rms_lsb[0]
        for law in (FIXED, ADAPTIVE)
        for motion in ("trapezoid", "sine")
    )
    return Claim(
        "A feedback control to dynamics compensation: the torques of the dynamics are put out, and the errors are fed "
        "back.",
        "Abstract, I",
        f"RMS error without → with the table, steps of the potentiometer (1.06°): {'; '.join(rows)}.",
        "The paper never switches it off. It is by far the most that anything here brings. Its equations as printed "
        "are wrong in gravity and Coriolis terms ([what is right](dynamics-errata.md)); these runs use the right ones.",
        is_better,
    )


def _adaptation(results: Results) -> Claim:
    right, heavy = (
        {law: results.of(law, "table", "sine", payload).rms_lsb[0] for law in (FIXED, ADAPTIVE)}
        for payload in ("right", "+50 %")
    )
    return Claim(
        "MRAS corrects the error and makes the control more reliable; its response was very good.",
        "III, IV",
        f"RMS error on the sine with the table, fixed gains → MRAS: {heavy[FIXED]:.2f} → {heavy[ADAPTIVE]:.2f} with "
        f"half as much payload again, {right[FIXED]:.2f} → {right[ADAPTIVE]:.2f} with the right one.",
        "It holds where the model is wrong, and only there. Most of it is the bias term, which the paper's source "
        "(Dubowsky and DesForges) does not have: [what each term is worth](ablation.md).",
        heavy[ADAPTIVE] < 0.2 * heavy[FIXED] and right[ADAPTIVE] > right[FIXED] - SAME_LSB,
    )


def _memory(results: Results) -> Claim:
    longer = {motion: results.runs[Case(FIXED, "table", motion, seconds=20.48)] for motion in ("sine", "trapezoid")}
    parts = "; ".join(f"{motion} {each.rms_lsb[0]:.2f}, then {each.rms_lsb[1]:.2f}" for motion, each in longer.items())
    return Claim(
        "The results are stored in $2000–$3FFF, a byte is put out every 2.5 ms, and measured positions and speeds are "
        "stored too; tens of seconds of two joints take “4K × 3bit”.",
        "II-4, III",
        f"Two joints of {SAMPLES} bytes fill the {PAPERS_BYTES} bytes: {SAMPLES * 0.0025:.2f} s. RMS error in the "
        f"first and in the second {SAMPLES * 0.0025:.2f} s of a longer run: {parts}.",
        "4K × 8 bit a joint, then, and ten seconds, not tens of them; and there is no room left for what is measured. "
        "Here the log has pages of its own, and the table is computed anew while the arm moves, which an Apple II "
        "could not: a longer run is as good as a short one.",
        2 * SAMPLES == PAPERS_BYTES
        and all(abs(each.rms_lsb[0] - each.rms_lsb[1]) < SAME_LSB for each in longer.values()),
    )


def _real_time(results: Results) -> Claim:
    table = results.of(FIXED, "table", "sine").rms_lsb[0]
    online = results.runs[Case(FIXED, "online", "sine")].rms_lsb[0]
    return Claim(
        "The computer's speed makes real-time control with the dynamics impossible; they are computed beforehand.",
        "I, IV",
        f"RMS error on the sine with the table, 8 bits a sample: {table:.2f} steps; with the dynamics computed in "
        f"every cycle (`--feedforward online`): {online:.2f}.",
        "A 6502 at 1.02 MHz has 2551 clock cycles in 2.5 ms; today's processors take microseconds for the same "
        "(`make bench`). It brings nothing: the reference is known beforehand, and 8 bits of the table are enough.",
        abs(table - online) < SAME_LSB,
    )


def _current_instead_of_torque(results: Results) -> Claim:
    cell = load_cell("konkuk1")
    step_a = cell.joints[0].drive.max_current_a / 255
    torques = " and ".join(f"{1e3 * step_a * joint.motor.torque_per_ampere:.0f}" for joint in cell.joints)
    return Claim(
        "No torque sensor: the motor's current is measured instead, which is cheaper.",
        "II-3",
        f"A step of the sense's 8 bits is {1e3 * step_a:.1f} mA, {torques} mN·m at the joints. Ten seconds of these "
        "currents are enough to find payload and friction ([how well](identify.md#how-well)).",
        "It holds. The sense shows no sign here; that of the last command is taken.",
        step_a < 0.01,
    )


def _high_speed(results: Results) -> Claim:
    peak_a = max(results.of(ADAPTIVE, "table", "trapezoid", payload).peak_a for payload in PAYLOADS)
    return Claim(
        "Current control and motor current have limits; fast work was hard.",
        "IV",
        f"The trapezoid can be shortened from 5.12 to {results.fastest_s:g} s; then {results.limit}. In these runs "
        f"{peak_a:.2f} A of 1.5 A are needed at most.",
        "Here the tachometer ends it before the current does: its range of ±2.5 rad/s is an assumption of ours, as are "
        "gears, masses and friction. The paper says none of them.",
        "tachometer" in results.limit and peak_a < 1.5,
    )


def page(results: Results) -> str:
    """docs/papers.md."""
    rows = [f"| {each.printed} ({each.where}) | {each.measured} | {each.differs} |" for each in claims(results)]
    return "\n".join(
        [
            "# What the first paper shows, on this bench",
            "",
            "Woo, Kim and Park built a controller for joints 2 and 3 of the KON-KUK I: a table of torques computed",
            "beforehand, MRAS on top, an Apple II. The paper says in words what came of it, and gives no figure.",
            "Below, each claim that this bench can repeat, measured on `konkuk1`. The page is written by `make paper`,",
            "which ends with an error when a sentence no longer fits the figures. `make docs` makes HTML of it.",
            "",
            "The second paper, two RHINO robots that carry one object, [has a page like this](rhino.md), and",
            "[one on the bench](carrying.md). [What is wrong in print](dynamics-errata.md) has a page too.",
            "",
            f"Runs are 10.24 s in lockstep, seed 0, the first 1024 cycles left out; `{FIXED}` has fixed gains,",
            f"`{ADAPTIVE}` is the paper's. “Right” is a payload as the controller thinks, “+50 %” a true `joint3.mass`",
            f"of 0.9 kg in place of 0.6. Made with {_versions()}.",
            "",
            "| printed | measured | what differs, and why |",
            "|---|---|---|",
            *rows,
            "",
            "## Every run",
            "",
            "Of the worse joint: RMS error in steps of its potentiometer, ripple and RMS acceleration where the speed",
            "should be constant, peak current.",
            "",
            "| law | feed-forward | motion | payload | RMS error | ripple | acceleration, rad/s² | peak, A |",
            "|---|---|---|---|---|---|---|---|",
            *(_row(case, outcome) for case, outcome in results.runs.items()),
            "",
            "Again, one of them:",
            "",
            "```",
            next(case.command for case in results.runs if case.law == ADAPTIVE and case.mass_kg != PAYLOADS["right"]),
            "```",
            "",
        ]
    )


def _row(case: Case, outcome: Outcome) -> str:
    payload = next(name for name, mass_kg in PAYLOADS.items() if mass_kg == case.mass_kg)
    motion = case.trajectory if len(outcome.rms_lsb) == 1 else f"{case.trajectory}, {case.seconds:g} s"
    errors = ", then ".join(f"{each:.2f}" for each in outcome.rms_lsb)
    has_steady = outcome.ripple == outcome.ripple  # NaN is unlike itself
    steady = f"{_percent(outcome.ripple)} | {outcome.roughness_rad_s2:.2f}" if has_steady else "– | –"
    return f"| {case.law} | {case.feedforward} | {motion} | {payload} | {errors} | {steady} | {outcome.peak_a:.2f} |"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def _versions() -> str:
    found = [f"{name} {importlib.metadata.version(name)}" for name in ("canarm", "mujoco", "numpy")]
    return f"{', '.join(found[:-1])} and {found[-1]}"
