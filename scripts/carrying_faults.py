"""Faults while two robots carry an object: how soon both stop, and what the hands' forces come to. Prints a table.

Draws moment, seed, law, motion and truth; every fault of a draw continues from a copy of the same run.
"""

import argparse
import math
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from canarm import Rig, State
from canarm.workers.forking import in_copy
from canarm_emulator.bench.bench import Bench
from canarm_emulator.robot.carried import GRIP_LOST, PAD_S, ObjectState
from canarm_protocol.canopen.dictionary import ANALOGUE_ERROR_VALUE, DIGITAL_ERROR_VALUE, variable_at
from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.sdo import download
from canarm_protocol.cell import Cell, load_cell
from canarm_protocol.cell.configuration import card_settings
from canarm_protocol.cell.sensing import position_steps_rad
from canarm_protocol.cell.wiring import card_nodes

LAWS = ("mras", "mras-lyapunov", "slotine-li")
MOTIONS = (
    "circle", "circle:seconds=2.5", "circle:radius_mm=20,plane=xy", "line:y_mm=40,seconds=4",
    "arc:radius_mm=15,angle_deg=180,plane=xz",
)  # fmt: skip
FIRST_S, LAST_S = 4.0, 9.0
"""Between these the fault begins: within a lap of 5 s, once the joints are homed and on their path."""
WATCHED_S, AFTER_S = 2.0, 2.0
"""How long the controller has, and how long the cards are then left alone."""
DEAD_S, STANDS_S, STANDS_DEG = 10.0, 1.0, 0.05
"""How long the cards are left alone by a controller that has died; and how little a joint turns that stands: half a
count of a shoulder in that time."""
TOGETHER_MS = 20.0
BLOW_MS = 1e3 * PAD_S
"""In which what a joint that jams had of momentum has gone through the hands."""
AS_AT_HOME = "the same, of a master that renews no error values"
KINDS = ("jam", "encoder", "silent", "card", "grip", "controller", "none")

Fault = tuple[str, str, dict[str, float]]


@dataclass(frozen=True)
class Outcome:
    """What became of one fault; the time to the stop in ms, None where there was none."""

    group: str
    name: str
    stop_ms: float | None
    detector: str
    grip_n: float
    is_lost: bool
    draw: str
    due: float = math.nan
    """Share of a count that the joint is to turn within `TOGETHER_MS`: what any detector could know by then."""
    lost_ms: float | None = None
    """When a hand lost the object; `BLOW_MS` at most is by the blow of a joint that jams, before anybody can act."""
    turned_deg: float = math.nan
    """How far the joint that turned most did so in the last `STANDS_S`."""


def faults(cell: Cell, kind: str) -> Iterator[tuple[str, str, list[Fault]]]:
    """Group, name and faults of one kind."""
    for joint in cell.joint_names:
        if kind == "jam":
            yield "a joint jams", joint, [(f"{joint}.link", "joint-jam", {})]
        elif kind == "encoder":
            yield "an encoder stands still", joint, [(f"{joint}.encoder", "stuck", {})]
            for counts in (4, 40):
                lost: Fault = (f"{joint}.encoder", "offset", {"value": -counts})
                yield f"an encoder loses {counts} counts", joint, [lost]
            yield "an encoder loses 50 counts a second", joint, [(f"{joint}.encoder", "drift", {"rate": -50})]
    for robot in cell.robot:
        nodes = [f"node.0x{card.node_id:02X}" for card in cell.card if card.robot == robot.name]
        if kind == "silent":
            for fault, group in (("line-broken", "line cut"), ("hang", "hang"), ("crash", "no power")):
                yield f"all cards of a robot: {group}", robot.name, [(node, fault, {}) for node in nodes]
    if kind == "card":
        for card in cell.card:
            what = "counter" if not card.kind.is_output else "output"
            node = f"node.0x{card.node_id:02X}"
            for fault, group in (("line-broken", "line cut"), ("hang", "hangs"), ("crash", "no power")):
                yield f"one {what} card: {group}", card.name, [(node, fault, {})]
    if kind == "grip":
        for hand in ("master", "slave"):
            yield f"the {hand}'s hand opens", hand, [(f"object.{hand}", "grip-opens", {})]
    if kind == "controller":
        yield "the controller dies", "", []
        yield AS_AT_HOME, "", []


def take_home_values(rig: Rig) -> None:
    """The cards have the error values of the cell's file again, as those of a master that never writes others."""
    for node in card_nodes(rig.cell):
        for setting in card_settings(node, rig.cell.bus):
            if setting.index in (ANALOGUE_ERROR_VALUE, DIGITAL_ERROR_VALUE):
                variable = variable_at(node.dictionary, setting.index, setting.subindex)
                assert variable is not None
                request = next(download(setting.index, setting.subindex, bytes(variable.encode_raw(setting.value))))
                rig._bench.receive(Frame(Cob.SDO_TO_SERVER + node.card.node_id, request))


def true_robot(cell: Cell, draw: random.Random) -> dict[str, float]:
    """Object ±50 %, friction ±30 %, half a count, 0.6 mm."""
    assert cell.object is not None
    truth = {"object.mass": cell.object.mass_kg * draw.uniform(0.5, 1.5)}
    truth |= {f"object.base_{axis}": draw.uniform(-0.0006, 0.0006) / math.sqrt(3) for axis in "xyz"}
    for name, joint, step_rad in zip(cell.joint_names, cell.joints, position_steps_rad(cell), strict=True):
        truth[f"{name}.coulomb"] = joint.motor.coulomb_friction_nm * draw.uniform(0.7, 1.3)
        truth[f"{name}.initial_deg"] = joint.home_deg + math.degrees(step_rad) * draw.uniform(-0.5, 0.5)
    return truth


def drawn_rig(cell: Cell, seed: str) -> tuple[Rig, float, str]:
    """A rig, the moment of the fault, and what was drawn: object ±50 %, friction ±30 %, half a count, 0.6 mm."""
    draw = random.Random(seed)
    truth = true_robot(cell, draw)
    law, motion, at_s = draw.choice(LAWS), draw.choice(MOTIONS), draw.uniform(FIRST_S, LAST_S)
    rig = Rig(cell, law, motion, seed=draw.randrange(2**31), truth=truth, history_s=LAST_S + WATCHED_S + 1.0)
    return rig, at_s, f"{seed}: {law}, {motion}, {at_s:.3f} s"


def outcome(rig: Rig, group: str, name: str, injected: list[Fault], draw: str) -> Outcome:
    """Go on with the faults: two seconds of the controller, then two of the cards alone."""
    begin_s, before, tick = rig.time_s, len(rig.detections), rig.controller.tick
    due = due_counts(rig, name) if name in rig.cell.joint_names else math.nan
    if group == AS_AT_HOME:
        take_home_values(rig)
    for tap, fault, parameters in injected:
        rig.inject(tap, fault, **parameters)
    if injected:
        rig.run(seconds=WATCHED_S)
    bench, grip_n = rig._bench, max((force_n for force_n in _since(rig, begin_s)), default=0.0)
    end_s = begin_s + (WATCHED_S + AFTER_S if injected else DEAD_S)
    stood: list[float] = []
    while rig.time_s < end_s:
        bench.advance(bench.time_ns + 10_000_000)
        bench.catch_up()
        if not stood and rig.time_s >= end_s - STANDS_S:
            stood = [joint.angle_rad for joint in bench.world.state()]
        grip_n = max(grip_n, *map(_length, (object_of(bench).master_force_n, object_of(bench).slave_force_n)))
    turned = zip(bench.world.state(), stood, strict=True)
    turned_deg = math.degrees(max(abs(joint.angle_rad - angle_rad) for joint, angle_rad in turned))
    stops = [each for each in rig.detections[before:] if each.reaction.stops]
    stop_ms = (stops[0].tick - tick) * rig.cell.bus.cycle_us / 1000 if stops else None
    detector = stops[0].detector if stops else ""
    lost_s = [each.time_s for each in rig.events if each.event == GRIP_LOST and each.time_s >= begin_s]
    lost_ms = 1e3 * (lost_s[0] - begin_s) if lost_s else None
    is_lost = bool(object_of(bench).lost)
    return Outcome(group, name, stop_ms, detector, grip_n, is_lost, draw, due, lost_ms, turned_deg)


def object_of(bench: Bench) -> ObjectState:
    """The object as it is now."""
    carried = bench.world.object
    assert carried is not None
    return carried


def _length(force_n: Sequence[float]) -> float:
    return math.hypot(*force_n)


def due_counts(rig: Rig, joint: str) -> float:
    """The share of a count that the reference of a joint goes within `TOGETHER_MS`, at most 1."""
    index, cycle_s = rig.cell.joint_names.index(joint), rig.cell.bus.cycle_s
    cycles = round(TOGETHER_MS / 1000 / cycle_s)
    reference = rig.controller.loop.trajectory.sample(rig.controller.tick, cycles + 1, cycle_s)
    gone_rad = reference.position_rad[-1][index] - reference.position_rad[0][index]
    return min(abs(float(gone_rad)) / position_steps_rad(rig.cell)[index], 1.0)


def _since(rig: Rig, begin_s: float) -> Iterator[float]:
    times_s, forces_n = rig.object.time_s, rig.object.grip_force_n
    yield from (float(force_n) for time_s, force_n in zip(times_s, forces_n, strict=True) if time_s >= begin_s)


def campaign(cell: Cell, kinds: tuple[str, ...], draws: int, seed: int, tell: Callable[[str], None]) -> list[Outcome]:
    """All faults of `kinds` in every draw; a draw that stops without any fault is one of its own."""
    found: list[Outcome] = []
    for number in range(draws):
        rig, at_s, draw = drawn_rig(cell, f"{seed}/{number}")
        rig.run(seconds=at_s)
        if rig.state is not State.RUNNING:
            stopped = rig.detections[-1].detector
            found.append(Outcome("no fault", "", rig.time_s * 1e3, stopped, 0.0, not rig.object.is_held, draw))
            tell(f"{draw}: stopped without a fault: {rig.reason}")
            continue
        rig._bench.load()
        for kind in kinds:
            for group, name, injected in faults(cell, kind):
                what = (rig, group, name, injected, draw)
                found.append(in_copy(lambda what=what: outcome(*what)))
        found.append(in_copy(lambda draw=draw, rig=rig: free(rig, draw)))
        tell(draw)
    return found


def free(rig: Rig, draw: str) -> Outcome:
    """The same run without a fault."""
    begin_s = rig.time_s
    rig.run(seconds=WATCHED_S)
    stop = None if rig.state is State.RUNNING else rig.time_s * 1e3
    detectors = ", ".join(sorted({each.detector for each in rig.detections}))
    return Outcome("no fault", "", stop, detectors, max(_since(rig, begin_s)), not rig.object.is_held, draw)


def table(found: list[Outcome]) -> Iterator[str]:
    """The groups in Markdown."""
    times_and_forces = "median, worst", "grip: median, worst"
    heads = "fault", "runs", "stopped", "within 20 ms", "a count is due", *times_and_forces, "lost", "stand"
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    for group in dict.fromkeys(each.group for each in found):
        rows = [each for each in found if each.group == group]
        stops = sorted(each.stop_ms for each in rows if each.stop_ms is not None)
        grips = sorted(each.grip_n for each in rows)
        soon = sum(stop <= TOGETHER_MS for stop in stops)
        times = f"{stops[len(stops) // 2]:g}, {stops[-1]:g} ms" if stops else ""
        lost = sum(each.is_lost for each in rows)
        blown = sum(each.lost_ms is not None and each.lost_ms <= BLOW_MS for each in rows)
        due = [each.due for each in rows if not math.isnan(each.due)]
        can = f"{100 * sum(due) / len(due):.0f} %" if due else ""
        low, high = likely(soon, len(rows))
        share = f"{soon}, {100 * low:.0f} to {100 * high:.0f} %"
        stand = sum(each.turned_deg <= STANDS_DEG and not each.is_lost for each in rows)
        yield (
            f"| {group} | {len(rows)} | {len(stops)} | {share} | {can} | {times} | "
            f"{grips[len(grips) // 2]:.1f}, {grips[-1]:.1f} N | "
            f"{lost}{f', {blown} by the blow' * bool(blown)} | {stand} |"
        )


def likely(hits: int, of: int) -> tuple[float, float]:
    """The share behind `hits` of so many, with 95 % confidence (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z, share = 1.96, hits / of
    middle, half = share + z * z / (2 * of), z * math.sqrt(share * (1 - share) / of + (z / (2 * of)) ** 2)
    return max((middle - half) / (1 + z * z / of), 0.0), min((middle + half) / (1 + z * z / of), 1.0)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cell", default="rhino-pair")
    parser.add_argument("--draws", type=int, default=6)
    parser.add_argument("--draw-seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=KINDS, help="only this; may be given several times")
    options = parser.parse_args()
    kinds = tuple(options.kind or KINDS)
    found = campaign(
        load_cell(options.cell), kinds, options.draws, options.draw_seed, lambda text: print(text, flush=True)
    )
    print("\n".join(table(found)))
    for each in found:
        if each.is_lost or (each.group == "no fault" and each.detector):
            print(each)


if __name__ == "__main__":
    main()
