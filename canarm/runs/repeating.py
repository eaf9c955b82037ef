"""A run once more, in lockstep, from what its folder says of it; and where the two logs differ first.

Of laws and motions only those that canarm brings are taken from a folder: a file that it names is never loaded.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from canarm_controller.laws.loading import LAWS
from canarm_controller.reference.trajectory import named_motions
from canarm_emulator.bench.robot_bus import is_sync
from canarm_emulator.serving.recording import POWER_ON_S, RECORDING, SCRIPT
from canarm_protocol.canopen.frames import Frame
from canarm_protocol.clock import Clock
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import FaultScript, script_of
from canarm_protocol.runs.can_log import log_frames
from canarm_protocol.runs.run_folder import CAN_LOG_FILE, EVENTS_FILE, candump_line
from canarm_protocol.shown import first_line, printable, quoted
from canarm_protocol.text_file import parse_toml

from ..rig.arguments import checked_seed, checked_switch
from ..rig.rig import Rig
from ..session import make_bench
from ..usage import UsageError
from .decoding import Decoder
from .run import Run, broke_off

AFTERWARDS_S = 5.0
"""A run that has stopped itself is repeated for so much longer: it has to stop by itself again."""
_BY_HAND = {
    "emergency-stop": "the emergency stop",
    "power-cycle": "the power cycle",
    RECORDING: "the stop of the recording",
}
"""Events of what nobody can repeat to the bit, or from which on frames are missing."""
MOST_S = 1e6
MOST_CYCLES = 40_000_000
"""A hundred thousand seconds of konkuk1."""


@dataclass(frozen=True)
class Comparison:
    """What a repetition has shown: whether all is the same, and in a line what was compared or differs first."""

    is_same: bool
    text: str


class _End(NamedTuple):
    """What came from `ns` on, since power-on, is not compared; and what was there."""

    ns: int
    what: str


def check_again(run: Run, folder: Path, law: str | None = None, trajectory: str | None = None) -> Comparison:
    """Run it once more, into `folder`, and compare. `law` and `trajectory` replace what the folder names.

    Raises `UsageError` for a run that cannot be repeated, with why, and what else building a run raises.
    """
    made = run.made_by
    if made.get("clock", "sync") != "sync":
        raise UsageError(f"{run.path}: ran on the wall clock, which nobody can repeat; --check is for lockstep")
    if run.begin_s:
        raise UsageError(f"{run.path}: its arm begins as the run before has left it; check that of a fresh emulator")
    by_hand = _by_hand(run)
    if not run.controller and law is None:
        return _compared(run, _with_recorded_frames(run), False, by_hand)
    state, end = run.summary.get("state"), by_hand
    cycles, margin = _cycles(run), round(AFTERWARDS_S / run.cell.bus.cycle_s)
    if state not in ("done", "failed"):
        broken_off = _End((cycles - 1) * run.cell.bus.cycle_ns, "the cycle in which it was broken off")
        end = broken_off if end is None else min(end, broken_off)
    again = _with_our_controller(run, folder, law, trajectory, cycles + margin * (state == "failed"))
    return _compared(run, again, state == "done", end)


def _with_our_controller(
    run: Run, folder: Path, law: str | None, trajectory: str | None, cycles: int
) -> Iterator[tuple[int, Frame]]:
    made, cell = run.made_by, run.cell
    law = law or _known(run, "law", tuple(LAWS))
    trajectory = trajectory or _known(run, "trajectory", named_motions(cell))
    feedforward = run.summary.get("feedforward") or made.get("feedforward")
    rig = Rig(
        cell,
        law,
        trajectory,
        feedforward=feedforward,
        seed=made.get("seed", 0),
        wire=made.get("wire", False),
        truth=_truth(run),
        history_s=cell.bus.cycle_s * 10,
        out=folder,
    )
    with rig:
        done = 0
        for cycle, event in _interventions(run):
            if done < cycle < cycles:
                rig.run((cycle - done) * cell.bus.cycle_s)
                done = cycle
            if cycle < cycles and not rig.controller.is_finished:
                _intervene(rig, event)
        if done < cycles and not rig.controller.is_finished:
            rig.run((cycles - done) * cell.bus.cycle_s)
    return log_frames(folder / CAN_LOG_FILE)


def _cycles(run: Run) -> int:
    """How many cycles have been controlled."""
    cycles = run.summary.get("ticks", len(run.controller.get("cycle", ())))
    if not isinstance(cycles, int) or not 0 < cycles <= MOST_CYCLES:
        raise UsageError(f"{run.path}: says {quoted(cycles)} of the number of its cycles; nothing can be repeated")
    return cycles


def _interventions(run: Run) -> list[tuple[int, dict[str, object]]]:
    """What was done to the robot from outside, with the number of cycles before it."""
    found = [each for each in run.event_list if each["event"] in (SCRIPT, "truth")]
    return [(each["cycle"] + 1, each) for each in found]


def _intervene(rig: Rig, event: Mapping[str, object]) -> None:
    if event["event"] == SCRIPT:
        rig.inject_file(_script(event))
    else:
        rig.change_truth(str(event.get("key")), str(event.get("value")))


def _with_recorded_frames(run: Run) -> Iterator[tuple[int, Frame]]:
    """The cards once more, driven by what another master sent."""
    made, decoder = run.made_by, Decoder(run.cell)
    seed = made.get("seed", 0)
    bench = make_bench(
        run.cell, _truth(run), Clock.SYNC, checked_seed(seed), checked_switch("wire", made.get("wire", False))
    )
    bench.start()
    scripts = iter([*(each for each in _interventions(run) if each[1]["event"] == SCRIPT), (MOST_CYCLES, {})])
    due, event = next(scripts)
    for _, frame in log_frames(run.path / CAN_LOG_FILE):
        if decoder.is_from_cards(frame) or frame.is_error:
            continue
        while bench.cycle + 1 >= due:
            bench.inject(_script(event))
            due, event = next(scripts)
        bench.receive(frame, "master")
        records, bench.records = bench.records, []
        bench.bench_records.clear()
        yield from ((record.time_ns, record.frame) for record in records)


def _script(event: Mapping[str, object]) -> FaultScript:
    try:
        return script_of(parse_toml(str(event.get("toml"))))
    except ValueError as error:
        raise FaultError(f"{EVENTS_FILE}: a {SCRIPT} is none: {first_line(error)}") from None


def _truth(run: Run) -> dict[str, str]:
    truth = run.made_by.get("truth") or {}
    if not isinstance(truth, Mapping):
        raise UsageError(f"{run.path}: truth: must be keys and values")
    return {str(key): str(value) for key, value in truth.items()}


def _known(run: Run, what: str, known: tuple[str, ...]) -> str:
    name = run.made_by.get(what)
    if name not in known:
        raise UsageError(
            f"{run.path}: its {what} {quoted(name)} is none of ours; if you trust it, name it with --{what}: nothing "
            "that a run folder names is executed"
        )
    return str(name)


def _by_hand(run: Run) -> _End | None:
    """The first emergency stop, power cycle or stop of the recording: at which moment of its cycle, nobody knows."""
    for event in run.event_list:
        what = _BY_HAND.get(str(event["event"]))
        at_s = event.get(POWER_ON_S)
        if what is not None and isinstance(at_s, int | float) and 0.0 <= at_s < MOST_S:
            return _End(round(at_s * 1e9) + 1, f"{what} at {event['time_s']:.4f} s")
    return None


def _compared(run: Run, again: Iterator[tuple[int, Frame]], is_planned: bool, end: _End | None = None) -> Comparison:
    """Frame by frame, as candump writes them: with their times; up to `end` if a signal or a hand has struck.

    A run is as long as its SYNCs. What was said after the last one, and after its controller's end, was said by others,
    such as a second controller that was refused: an emulator keeps it in the log of the run before.
    """
    decoder = Decoder(run.cell)
    count = 0
    recorded = log_frames(run.path / CAN_LOG_FILE, run.complaints.append)
    for before, now in itertools.zip_longest(recorded, again):
        if before is None or now is None:
            break
        if end is not None and before[0] >= end.ns:
            return Comparison(count > 0, f"the same: every byte of can0 up to {end.what} ({count} frames)")
        if candump_line(before[0], "can0", before[1]) != candump_line(now[0], "can0", now[1]):
            text = (
                f"frame {count + 1} differs first: recorded {_stamped(decoder, *before)}, now {_stamped(decoder, *now)}"
            )
            return Comparison(False, text)
        count += 1
    else:
        return Comparison(count > 0, f"the same: every byte of can0 ({count} frames)" if count else "no frames")
    if now is None and count:
        assert before is not None
        rest = [before[1], *(frame for _, frame in recorded)]
        if not is_planned or not any(is_sync(frame) for frame in rest):
            return Comparison(
                True,
                f"the same: every byte of can0 up to the end of its controller ({count} frames); not "
                f"compared: {len(rest)} frames after it",
            )
    if before is None and count and (why := broke_off(run.configuration)):
        text = f"the same: every byte of can0 up to where its recording broke off ({count} frames): {printable(why)}"
        return Comparison(True, text)
    more = "the recorded run" if now is None else "the repetition"
    extra = before or now
    assert extra is not None
    return Comparison(False, f"{count} frames are the same, then {more} goes on: {decoder.text(extra[1])}")


def _stamped(decoder: Decoder, time_ns: int, frame: Frame) -> str:
    return f"at {time_ns * 1e-9:.6f} s {decoder.text(frame)}"
