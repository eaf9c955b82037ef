"""Jogging against the emulated bench in one process: the two cores joined by a list, in virtual time on both clocks."""

from collections.abc import Callable

import pytest

from canarm.jogging.cards import JogError
from canarm.jogging.jog import Jog, Work
from canarm.jogging.parsing import Parser
from canarm.session import make_bench
from canarm_controller.bus.master import Silence
from canarm_controller.errors import BringUpError
from canarm_protocol.canopen.frames import Emergency, Frame, NmtState
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.cell.wiring import card_nodes
from canarm_protocol.clock import Clock

CELL = load_cell("konkuk1")
SILENT = {f"{joint}.noise_lsb": "0" for joint in CELL.joint_names}
MILLISECOND = 1_000_000
DAC = 0x12
CODE_A = 1.5 / 255


class Table:
    """A bench, and somebody at the prompt."""

    def __init__(self, clock: Clock, with_wire: bool = False) -> None:
        nodes = card_nodes(CELL)
        self.bench = make_bench(CELL, SILENT, clock, 0, with_wire)
        self.jog = Jog(CELL, nodes, clock)
        self.sent: list[Frame] = []
        self.advance = self.bench.advance
        """Lets the bench's time pass up to a time in ns."""
        self._parser = Parser(CELL, nodes)
        self.bench.start()
        self.bench.records.clear()

    def begin(self) -> None:
        self.carry_out(self.jog.begin(250 * MILLISECOND))

    def do(self, text: str) -> list[str]:
        return [line for command in self._parser.parse_all(text) for line in self.carry_out(self.jog.run(command))]

    def command(self, text: str):
        (command,) = self._parser.parse_all(text)
        return command

    def carry_out(self, work: Work) -> list[str]:
        try:
            ask = next(work)
            while True:
                answers = [frame for frame in self.exchange(ask.frames) if ask.is_answer(frame)]
                if not answers:
                    answers = [frame for frame in self.wait(ask.limit_ns, ask.is_answer) if ask.is_answer(frame)]
                ask = work.send(answers[0]) if answers else work.throw(Silence())
        except StopIteration as done:
            return list(done.value)
        finally:
            self.exchange(())

    def exchange(self, frames) -> list[Frame]:
        """Send, and hand over what comes back; the bench's clock stands still."""
        gathered, self.jog.outbox = self.jog.outbox, []
        for frame in (*gathered, *frames):
            self.sent.append(frame)
            self.bench.receive(frame, self)
        records, self.bench.records = self.bench.records, []
        received = [record.frame for record in records if record.origin is None]
        for frame in received:
            self.jog.receive(frame, self.jog.now_ns)
        return received

    def wait(self, time_ns: int, is_enough: Callable[[Frame], bool] = lambda frame: False) -> list[Frame]:
        """On the wall clock the world goes on meanwhile, and heartbeats go out, until a frame comes that is enough."""
        end_ns = self.jog.now_ns + time_ns
        while self.jog.now_ns < end_ns:
            self.jog.now_ns = min(self.jog.now_ns + MILLISECOND, end_ns)
            if self.jog.clock is Clock.WALL:
                self.advance(self.jog.now_ns)
            received = self.exchange(self.jog.heartbeat_if_due())
            if any(map(is_enough, received)):
                return received
        return []

    def commands_a(self) -> list[float]:
        return [joint.command_a for joint in self.bench.world.state()]


@pytest.fixture(params=[Clock.SYNC, Clock.WALL], ids=["sync", "wall"])
def table(request) -> Table:
    table = Table(request.param)
    table.begin()
    return table


@pytest.fixture
def lockstep() -> Table:
    table = Table(Clock.SYNC)
    table.begin()
    return table


def test_cards_are_operational_and_nothing_moves_at_first(table):
    assert {slave.state for slave in table.bench.slaves} == {NmtState.OPERATIONAL}
    assert table.commands_a() == [0.0, 0.0]
    assert table.do("state")[1] == "card dac (0x12): OPERATIONAL, error register 0x00"


def test_outputs_act_at_the_next_step_and_magnitude_and_direction_together(table):
    table.do("current joint2 0.4; dac joint3 51; dir joint3 cw")
    assert table.commands_a() == [0.0, 0.0]
    assert table.do("state")[-1] == "joint3: code 0, off, 0.000 A; from the next step joint3: code 51, cw, -0.300 A"
    table.do("step")
    assert table.commands_a() == pytest.approx([68 * CODE_A, -51 * CODE_A])
    assert table.do("state")[-1] == "joint3: code 51, cw, -0.300 A"


def test_a_read_moves_nothing_that_waits_for_a_step(table):
    table.do("current joint2 0.4")
    table.do("read")
    assert table.commands_a() == [0.0, 0.0]


def test_a_read_shows_code_and_physical_value_of_every_input(table):
    lines = table.do("read")
    assert len(lines) == 6
    # 270 degrees and 255 codes around 127.5: 20 degrees are code 146, which stands for 19.588 degrees
    assert lines[0].split() == ["joint2.potentiometer", "146", "19.588", "deg"]
    assert lines[2].split() == ["joint2.current_sense", "0", "0.000", "A"]


def test_a_reading_waits_for_an_emulator_that_a_busy_machine_keeps_behind():
    table = Table(Clock.WALL)
    table.begin()
    known, behind_ns = table.do("read"), 16 * CELL.bus.cycle_ns
    table.advance = lambda until_ns: table.bench.advance(until_ns - behind_ns)
    assert table.do("read") == known
    table.advance = lambda until_ns: None
    with pytest.raises(JogError, match=r"did not come within 1 s of SYNC: 0x294, 0x394"):
        table.do("read")


def test_the_sensed_current_is_the_one_that_was_set(lockstep):
    lockstep.do("current joint2 0.4; step 8")
    assert lockstep.do("read")[2].split() == ["joint2.current_sense", "68", "0.400", "A"]


def test_steps_move_time_by_cycles_in_lockstep_and_not_otherwise(lockstep):
    before_ns = lockstep.bench.time_ns
    lockstep.do("read; state; current joint2 0.4; sdo read adc 0x6401 1")
    assert lockstep.bench.time_ns == before_ns
    assert lockstep.do("step 11")[0].startswith("cycle 10, 25 ms: joint2 ")
    assert lockstep.bench.cycle == 10
    # ten periods of 2.5 ms, and the last scan of six channels of 100 us
    assert lockstep.bench.time_ns - before_ns == 25 * MILLISECOND + 600_000


@pytest.mark.parametrize("commands", ["step 10; read", "step 10; state", "step 3; read; step 3; read"])
def test_with_the_wire_model_cards_answer_between_steps_in_lockstep(commands):
    table = Table(Clock.SYNC, with_wire=True)
    table.begin()
    waited = []
    table.wait = waited.append
    lines = table.do(f"current joint2 0.57; {commands}")
    assert waited == []
    assert any(line.startswith(("joint2.potentiometer", "card dac (0x12): OPERATIONAL")) for line in lines)
    # 0.57 A are 97 codes
    assert table.commands_a()[0] == pytest.approx(97 * CODE_A)
    table.exchange(table.jog.end())
    assert table.commands_a() == [0.0, 0.0]


def test_what_was_read_while_the_bench_ran_on_is_not_shown(lockstep):
    lockstep.do("current joint2 0.4; step")
    exchange = lockstep.exchange

    def run_on_and_exchange(frames):
        lockstep.bench.run_on()
        lockstep.exchange = exchange
        return exchange(frames)

    lockstep.exchange = run_on_and_exchange
    with pytest.raises(JogError, match="0x8130"):
        lockstep.do("read")


def test_a_loss_after_the_last_command_is_told(lockstep):
    lockstep.do("current joint2 0.4; step")
    lockstep.bench.run_on()
    lockstep.exchange(())
    with pytest.raises(JogError, match="0x8130"):
        lockstep.jog.check()


def test_virtual_time_that_somebody_else_moves_is_an_alarm(lockstep):
    """Two cycles pass between two of ours, without a SYNC that we could see."""
    lockstep.do("step 2")
    for _ in range(3):
        lockstep.bench.receive(Frame(0x080, b"\x01"), lockstep)
    lockstep.bench.records.clear()
    with pytest.raises(JogError, match="virtual time did not move by a cycle"):
        lockstep.do("step")
    assert {slave.state for slave in lockstep.bench.slaves} == {NmtState.PRE_OPERATIONAL}


def test_steps_of_cards_that_do_not_run_say_that_nothing_is_driven(lockstep):
    text = lockstep.do("reset; step 4")[-1]
    assert text.endswith(": nothing is driven, the cards are not in OPERATIONAL; type: start")


def test_an_interrupted_step_ends_with_its_cycle(lockstep):
    lockstep.do("current joint2 0.4")
    work = lockstep.jog.run(lockstep.command("step 100"))
    ask = next(work)
    assert lockstep.jog.is_stepping
    lockstep.jog.interrupt()
    with pytest.raises(StopIteration) as done:
        work.send(next(frame for frame in lockstep.exchange(ask.frames) if ask.is_answer(frame)))
    assert done.value.value[0].endswith("; interrupted after 1 of 100 cycles")
    assert not lockstep.jog.is_stepping
    assert lockstep.bench.cycle == 0
    lockstep.do("step")


def test_a_burst_on_the_wall_clock_keeps_the_period_and_the_heartbeat():
    table = Table(Clock.WALL)
    table.begin()
    before_ns = table.bench.time_ns
    assert table.do("step 400")[0].startswith("cycle 399: joint2 ")
    assert table.bench.time_ns - before_ns == 1000 * MILLISECOND
    table.wait(3000 * MILLISECOND)
    assert table.do("state")[1] == "card dac (0x12): OPERATIONAL, error register 0x00"


def test_off_stop_and_preop_take_the_current_away(table):
    for command, state in (
        ("off; step", NmtState.OPERATIONAL),
        ("stop", NmtState.STOPPED),
        ("preop", NmtState.PRE_OPERATIONAL),
        ("reset", NmtState.PRE_OPERATIONAL),
    ):
        if not table.jog.is_driving:
            table.do("start")
        table.do("current joint2 0.4; step")
        assert table.commands_a()[0] > 0.0
        table.do(command)
        assert table.commands_a() == [0.0, 0.0]
        assert {slave.state for slave in table.bench.slaves} == {state}
        if state is not NmtState.OPERATIONAL:
            with pytest.raises(JogError, match="type: start"):
                table.do("current joint2 0.4")
        if state is NmtState.STOPPED:
            with pytest.raises(JogError, match="type: preop"):
                table.do("read")
            table.do("state; preop")


def test_objects_are_read_and_written_by_sdo(lockstep):
    assert lockstep.do("sdo read adc 0x1008") == ["adc 0x1008:00 Manufacturer device name = ADC0809 card"]
    lockstep.do("sdo write dac 0x1017 0 50")
    assert lockstep.do("sdo read dac 0x1017") == ["dac 0x1017:00 Producer heartbeat time = 50 (0x0032)"]
    with pytest.raises(JogError, match="0x06010002"):
        lockstep.do("sdo write dac 0x1000 0 1")
    with pytest.raises(JogError, match="0x06020000"):
        lockstep.do("sdo read dac 0x5000")


def test_the_end_leaves_outputs_off_and_cards_pre_operational(table):
    table.do("current joint2 0.4; step")
    table.exchange(table.jog.end())
    assert table.commands_a() == [0.0, 0.0]
    assert {slave.state for slave in table.bench.slaves} == {NmtState.PRE_OPERATIONAL}


def test_an_emergency_of_a_card_puts_the_outputs_off_and_is_told_once(table):
    table.do("current joint2 0.4; step")
    table.jog.receive(Emergency(0x8210, 0x11).frame(DAC), table.jog.now_ns)
    with pytest.raises(JogError, match=r"'dac' \(node 0x12\) reports error 0x8210; outputs are off"):
        table.do("step")
    assert table.commands_a() == [0.0, 0.0]
    table.do("start; current joint2 0.4; step")
    assert table.commands_a()[0] > 0.0


def test_a_silent_adc_ends_a_burst_after_as_many_cycles_as_the_cell_says(lockstep):
    lockstep.do("sdo write adc 0x1017 0 0; preop; sdo write adc 0x1801 1 0x80000294; sdo write adc 0x1802 1 0x80000394")
    limit = CELL.supervision.missing_cycles
    text = lockstep.do(f"start; step {limit - 1}")[-1]
    assert text.endswith(f"; {limit - 1} cycles without all inputs")
    with pytest.raises(JogError, match=f"no TPDO 0x294 and TPDO 0x394 for {limit} cycles; outputs are off"):
        lockstep.do("step 100")
    assert lockstep.jog.cycle == 2 * limit - 2


def test_cards_that_went_safe_in_lockstep_because_nobody_stepped_say_so(lockstep):
    lockstep.do("current joint2 0.4; step")
    lockstep.bench.run_on()
    lockstep.exchange(())
    with pytest.raises(JogError, match=r"0x8130 \(nothing came for the emulator's --sync-timeout"):
        lockstep.do("step")
    assert lockstep.commands_a() == [0.0, 0.0]


@pytest.mark.parametrize("frame", [Frame(0x080, b"\x01"), Frame(0x701, b"\x05")])
def test_another_controller_ends_it(table, frame):
    table.do("current joint2 0.4; step")
    table.jog.receive(frame, table.jog.now_ns)
    assert table.jog.is_over
    with pytest.raises(JogError, match="another controller is on the bus"):
        table.do("step")
    assert table.commands_a() == [0.0, 0.0]


@pytest.mark.parametrize("frame", [Frame(0x080, b"\x01"), Frame(0x701, b"\x05")])
def test_it_does_not_touch_the_bus_of_another_controller(frame):
    table = Table(Clock.WALL)
    work = table.jog.begin(250 * MILLISECOND)
    ask = next(work)
    assert ask.is_answer(frame)
    with pytest.raises(BringUpError, match="another controller"):
        work.send(frame)
    assert (table.jog.end(), table.jog.outbox, table.sent) == ([], [], [])


def test_state_before_the_first_step_says_that_there_was_none(lockstep):
    assert lockstep.do("state")[0] == "clock sync, no cycle yet"
    lockstep.do("step 1")
    assert lockstep.do("state")[0] == "clock sync, cycle 0"


@pytest.mark.parametrize(
    "settings",
    [
        [("dac", "0x1016 1 0"), ("dac", "0x1016 2 0x10064")],
        [("dac", "0x1006 0 0"), ("dac", "0x1019 0 0")],
        [("dac", "0x1401 5 1")],
        [("adc", "0x1007 0 1")],
        [("adc", "0x1801 2 4"), ("adc", "0x1802 2 254")],
        [("adc", f"0x180{pdo} {setting}") for pdo in (1, 2) for setting in ("1 0x80000294", "3 400", "6 5")],
        [("adc", "0x1014 0 0x80000094"), ("adc", "0x1014 0 0x1f0"), ("adc", "0x1015 0 1000")],
        [("latch", "0x6208 1 0")],
    ],
    ids=["watches-twice", "no-counter", "rpdo-timer", "window", "types", "inhibit-and-start", "emcy", "filter-mask"],
)
def test_what_a_card_has_stored_does_not_get_in_the_way_of_our_masters(lockstep, settings):
    """CiA 301, 0x1010: stored values outlast every reset."""
    lockstep.do("preop")
    for card, words in settings:
        lockstep.do(f"sdo write {card} {words}")
    for card in {card for card, _ in settings}:
        lockstep.do(f"sdo write {card} 0x1010 1 0x65766173")
    lockstep.do("reset; start; current joint2 0.57; step 10")
    assert "cycles without all inputs" not in lockstep.do("step 10")[0]
    assert lockstep.commands_a()[0] == pytest.approx(97 * CODE_A, abs=CODE_A / 2)
    assert [line.split()[-1] for line in lockstep.do("state")[1:4]] == ["0x00"] * 3
