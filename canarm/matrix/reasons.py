"""Why a cell of the matrix does not pass, in words and numbers. Findings in, a phrase out; nothing is judged."""

from collections.abc import Iterator

from .judgement import DETECTION_S, TOLERATED_LSB, Findings, Verdict
from .safety import FTTI_S, GROWTH_RAD_S, SAFE_CURRENT_A, SAFE_SPEED_RAD_S


def why(found: Findings) -> str:
    """What keeps the run from passing, such as "late: 70 ms > 25 ms; not tolerated: stopped"; empty if it passes."""
    phrases = []
    if found.verdict is Verdict.LATE and found.latency_s is not None:
        phrases.append(f"late: {_ms(found.latency_s)} > {_ms(DETECTION_S)}")
    elif found.verdict is Verdict.MISSED:
        phrases.append("missed: nothing noticed")
    if phrases:
        phrases.append(f"not tolerated: {_intolerable(found)}")
    if not found.is_safe:
        phrases.append(f"not safe: {', '.join(_unsafe(found))}")
    return "; ".join(phrases)


def _intolerable(found: Findings) -> str:
    if not found.is_running:
        return "stopped"
    if found.astray_lsb is None:
        return "no reference to the end"
    return f"error {found.astray_lsb:.3g} LSB > {TOLERATED_LSB:g} LSB"


def _unsafe(findings: Findings) -> Iterator[str]:
    if findings.lost_by:
        yield f"the object is lost by the {' and the '.join(findings.lost_by)}"
    found = findings.safety
    if found.current_a > SAFE_CURRENT_A:
        yield f"current {found.current_a:.4g} A > {SAFE_CURRENT_A:g} A"
    if found.growth_rad_s > GROWTH_RAD_S:
        yield f"faster by {found.growth_rad_s:.3g} rad/s > {GROWTH_RAD_S:g} rad/s"
    if found.braked_rad_s > SAFE_SPEED_RAD_S:
        yield f"speed {found.braked_rad_s:.3g} rad/s > {SAFE_SPEED_RAD_S:g} rad/s in spite of the brake"
    if found.driven_w > 0.0:
        yield f"a drive puts {found.driven_w:.3g} W into the arm after its torque is off"
    if found.safe_s is None:
        yield "never off, at rest or back at the reference for good"
    elif found.safe_s > FTTI_S:
        yield f"{found.by} only after {_ms(found.safe_s)}"


def _ms(seconds: float) -> str:
    return f"{round(seconds * 1e3, 3):g} ms"
