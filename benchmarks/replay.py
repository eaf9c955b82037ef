"""One run of a cell, kept as what went to and from the bench, and each part of a cycle given the same again, alone.

A part is timed by what it takes for the same cycles once more, so that compiled and plain code are measured alike:
nothing is hooked into what is measured. Which part is what share of a cycle is not known here.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from canarm import Rig
from canarm.session import make_bench, make_controller
from canarm_controller.dynamics import cell_arm
from canarm_controller.laws.loading import load_law
from canarm_controller.reference.trajectory import make_trajectory, usual_motion
from canarm_controller.run.awaited_inputs import AwaitedInputs
from canarm_controller.run.controller import Controller
from canarm_controller.run.loop import ControlLoop
from canarm_emulator.bench_node.assessor import Assessor
from canarm_emulator.cards.rack import Mapped
from canarm_emulator.faults.fault_bench import FaultBench
from canarm_emulator.node.slave import Slave
from canarm_emulator.robot.plant import Plant
from canarm_emulator.robot.scan_schedule import ScanSchedule
from canarm_emulator.robot.truth import Truth
from canarm_emulator.robot.world import JointState, Quantity
from canarm_protocol.canopen.frames import Cob, Frame
from canarm_protocol.canopen.pdo import PdoLayout
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.model import SENSOR_KINDS, Cell
from canarm_protocol.cell.wiring import bridge_directions, card_nodes, input_slots
from canarm_protocol.clock import Clock

LAW = "mras"
Stamped = tuple[Frame, int]


@dataclass(frozen=True, slots=True)
class Turn:
    """What the controller sends to the bench, what the cards answer and when, the codes in it, and the truth."""

    sent: Sequence[Frame]
    answers: Sequence[Stamped]
    codes: Sequence[int]
    joints: Sequence[JointState]
    reference_rad: Sequence[float]


@dataclass(frozen=True, slots=True)
class Recorded:
    """The turns that bring the cards up, and those of the controlled cycles after the first."""

    cell: Cell
    opening: Sequence[Turn]
    cycles: Sequence[Turn]


def new_bench(cell: Cell) -> FaultBench:
    """A bench in lockstep that has been switched on."""
    bench = make_bench(cell, {}, Clock.SYNC, 0)
    bench.start()
    return bench


def new_controller(cell: Cell) -> Controller:
    """A controller that looks for its cards."""
    controller = make_controller(cell, LAW, usual_motion(cell), None, Clock.SYNC)
    controller.begin(0)
    return controller


def record(cell_name: str, cycles: int) -> Recorded:
    """A run until `cycles` after the first controlled one; detectors are on, no fault is."""
    cell = load_cell(cell_name)
    nodes = card_nodes(cell)
    inputs = AwaitedInputs(nodes, input_slots(cell, nodes))
    bench, controller = new_bench(cell), new_controller(cell)
    truths: list[Sequence[JointState]] = [()]
    bench.on_cycle = lambda truth: truths.append(truth.joints)
    opening: list[Turn] = []
    controlled: list[Turn] = []
    while len(controlled) < cycles:
        turns = controlled if controller.controlled_ticks else opening
        sent, controller.outbox = controller.outbox, []
        for frame in sent:
            bench.receive(frame, controller)
        records, bench.records, bench.bench_records = bench.records, [], []
        answers = [(each.frame, each.time_ns) for each in records if each.origin is None]
        for frame, time_ns in answers:
            controller.receive(frame, time_ns)
            if (layout := inputs.layouts.get(frame.can_id)) is not None:
                inputs.take(layout, frame.data)
        if controller.is_finished:
            raise RuntimeError(f"{cell_name}: the run to be measured has ended: {controller.reason}")
        reference_rad = tuple(controller.loop.cycle.reference_rad)
        turns.append(Turn(sent, answers, list(inputs.codes), truths[-1], reference_rad))
    return Recorded(cell, opening, controlled)


def rig_s(run: Recorded) -> float:
    """Seconds of CPU that a `Rig` takes for as many cycles: the whole."""
    with Rig(run.cell, law=LAW, seed=0) as rig:
        rig.run(run.cell.bus.cycle_s)
        return spent(lambda: rig.run(len(run.cycles) * run.cell.bus.cycle_s))


def controller_s(run: Recorded) -> float:
    """The same for a controller alone."""
    controller = new_controller(run.cell)

    def take(turns: Sequence[Turn]) -> None:
        for turn in turns:
            controller.outbox = []
            for frame, time_ns in turn.answers:
                controller.receive(frame, time_ns)

    take(run.opening)
    return spent(lambda: take(run.cycles))


def loop_s(run: Recorded) -> float:
    """The same for what computes the outputs from the inputs: scales, reference, feed-forward, law."""
    cell = run.cell
    slots = input_slots(cell, card_nodes(cell))
    loop = ControlLoop(cell, slots, load_law(LAW), make_trajectory(usual_motion(cell), cell))
    codes = run.cycles[0].codes
    loop.begin([code for code, slot in zip(codes, slots, strict=True) if slot.quantity is Quantity.POSITION])

    def control() -> None:
        for tick, turn in enumerate(run.cycles):
            loop.measure(turn.codes, tick)
            loop.look_up(tick)
            loop.outputs(loop.eased(loop.torque_nm()))

    return spent(control)


def bench_s(run: Recorded) -> float:
    """The same for a bench alone."""
    bench = new_bench(run.cell)

    def take(turns: Sequence[Turn]) -> None:
        for turn in turns:
            for frame in turn.sent:
                bench.receive(frame)
            bench.records, bench.bench_records = [], []

    take(run.opening)
    return spent(lambda: take(run.cycles))


def cards_and_world_s(run: Recorded) -> float:
    """The same for the cards as nodes, with the world at their other side, without a bus."""
    bench = _brought_up(run)
    period_ns = run.cell.bus.cycle_ns
    takers = {layout.cob_id: (slave, layout) for slave in bench.slaves for layout in slave.pdos.rpdos}

    def work() -> None:
        now_ns = bench.world.time_ns
        mapped: Mapped = ()
        pdos_before: list[tuple[Slave, PdoLayout]] = []
        for turn in run.cycles:
            for frame in turn.sent:
                if frame.can_id == Cob.SYNC:
                    sync = frame.data
                elif frame.can_id in takers:
                    slave, layout = takers[frame.can_id]
                    slave.on_rpdo(layout, frame.data, now_ns)
            pdos = [(slave, layout) for slave in bench.slaves for layout in slave.on_sync(sync, now_ns)]
            if pdos != pdos_before:
                pdos_before = pdos
                mapped = tuple((slave.node_id, each) for slave, layout in pdos for each in layout.objects)
            bench.rack.convert(mapped)
            for slave, layout in pdos:
                slave.pdos.send(layout, now_ns)
            bench.records = []
            now_ns += period_ns
            bench.world.advance(now_ns)

    return spent(work)


def world_s(run: Recorded) -> float:
    """The same for the world alone: drives and sensors, integration of the arms; it is driven as its drives were."""
    cell, world = run.cell, _brought_up(run).world
    schedule = ScanSchedule.merged(
        [
            (
                [world.source(cell.far_joint(card, each), SENSOR_KINDS[each.leaf].quantity) for each in card.channel],
                card.channel_us * 1000,
            )
            for card in cell.card
            if not card.kind.is_output
        ]
    )
    ways = [tuple(map(int, bridge_directions(cell, joint))) for joint in range(len(cell.joints))]
    limits_a = [joint.drive.max_current_a for joint in cell.joints]
    commands = [
        [
            (abs(joint.command_a) / limit, way[joint.command_a > 0.0])
            for joint, way, limit in zip(turn.joints, ways, limits_a, strict=True)
        ]
        for turn in run.cycles
    ]

    def work() -> None:
        now_ns = world.time_ns
        for command in commands:
            for joint, (fraction, way) in enumerate(command):
                world.set_dac_output(joint, fraction)
                world.set_direction(joint, way)
            world.scan(schedule)
            now_ns += cell.bus.cycle_ns
            world.advance(now_ns)

    return spent(work)


def physics_s(run: Recorded) -> float:
    """The same for the integration of the arms alone, under the torques of their motors."""
    cell = run.cell
    plant = Plant(cell, Truth.from_settings(cell, {}))
    per_ampere = cell_arm(cell.laden, cell.joint_names).torque_per_ampere
    torques = [
        [each.current_a * scale for each, scale in zip(turn.joints, per_ampere, strict=True)] for turn in run.cycles
    ]
    first = run.cycles[0].joints
    rotors = [
        each for each, motor, joint in zip(first, plant.motor_dof, range(len(first)), strict=True) if motor != joint
    ]
    plant.set_state(
        [*(each.angle_rad for each in first), *(each.motor_angle_rad for each in rotors)],
        [*(each.speed_rad_s for each in first), *(each.motor_speed_rad_s for each in rotors)],
    )
    steps = steps_per_cycle(cell)
    step_s = cell.bus.cycle_s / steps

    def work() -> None:
        for torque_nm in torques:
            for _ in range(steps):
                plant.step(torque_nm, step_s)

    return spent(work)


def assessor_s(run: Recorded) -> float:
    """The same for the figures of the run that the bench keeps."""
    assessor = Assessor(run.cell)
    assessor.begin()
    none_limited = [0] * len(run.cell.joints)

    def work() -> None:
        for tick, turn in enumerate(run.cycles):
            assessor.truth(tick, turn.joints, none_limited)
            for joint, angle_rad in enumerate(turn.reference_rad):
                assessor.reference(tick, joint, angle_rad)

    return spent(work)


def steps_per_cycle(cell: Cell) -> int:
    """Steps of integration: those of the scan, which ends between two, and those until the next SYNC."""
    scan_us = max(len(card.channel) * card.channel_us for card in cell.card if not card.kind.is_output)
    longest_us = cell.physics.max_step_us
    return -(-scan_us // longest_us) - (scan_us - cell.bus.cycle_us) // longest_us


def spent(work: Callable[[], None]) -> float:
    """Seconds of CPU that `work` takes in this process."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _brought_up(run: Recorded) -> FaultBench:
    bench = new_bench(run.cell)
    for turn in run.opening:
        for frame in turn.sent:
            bench.receive(frame)
    bench.records, bench.bench_records = [], []
    return bench
