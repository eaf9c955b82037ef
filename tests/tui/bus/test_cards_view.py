"""The view of the cards on a fake bus, with a hand that only notes what it is told.

Volts and values: 8 bits over 15 V of the op-amp and 1.5 A of the amplifier, over 5 V and 270 degrees of the
potentiometer (cell konkuk1, from the paper).
"""

import pytest
from textual.widgets import Input

from canarm_protocol.canopen.frames import Frame
from canarm_tui import DashboardApp
from canarm_tui.bus.hand import HandState
from canarm_tui.grid import Grid
from tests.tui.bus.frames import at_once, cycles, frame, shown
from tests.tui.screens import SIZES, at_every_size, screen_lines


class NotedHand:
    """Notes what it is told; its codes are those of the last dac command."""

    def __init__(self):
        self.state, self.lines, self.codes, self.directions = HandState.OFF, [], (), ()
        self.told = []

    help = "read\n    all inputs\n" + "\n".join(f"command {number}\n    what it does" for number in range(14))

    def take(self):
        self.state, self.codes, self.directions = HandState.READY, (0, 0), ("off", "off")
        self.lines.append((False, "cards are in OPERATIONAL, outputs off"))

    def do(self, commands):
        self.told.append(commands)
        words = commands.split()
        if words[0] == "dac":
            self.codes = (int(words[2]), self.codes[1])
        if words[0] == "dir":
            self.directions = (words[2], self.directions[1])

    def release(self):
        self.state, self.codes = HandState.OFF, ()

    def close(self):
        self.told.append("close")


@pytest.fixture
def hand():
    return NotedHand()


@pytest.fixture
def bench_port(port):
    return type(port)()


@pytest.fixture
def app(cell, bench_port, clock, watch, hand):
    return DashboardApp(cell, lambda: bench_port, clock_ns=clock, in_background=at_once, bus=watch, hand=hand)


async def running(app, port, pilot, count=8):
    """The bus is looked at from before the start on."""
    await pilot.press("5")
    app.drain()
    port.arriving = [(0, Frame(0x000, b"\x01\x00")), *cycles(0, count)]
    await shown(app, pilot)


def line_of(app, text):
    return next((line for line in screen_lines(app) if text in line), "")


async def test_the_view_at_every_size(app, port):
    async with app.run_test(size=SIZES[0]) as pilot:
        await running(app, port, pilot, 600)
        await at_every_size(app, pilot, "cards", "#pane-cards")


async def test_a_channel_has_registers_code_volts_and_value(app, port):
    async with app.run_test(size=(160, 40)) as pilot:
        await running(app, port, pilot)
        # 0x2200 >> 7 is code 68: 4 V of 15, 0.4 A of 1.5; its nibbles are 4 and 4, in slot 2 from $C0A0 on.
        line = " ".join(line_of(app, "joint2.current_command").split())
        assert line.startswith(
            "2 $C0A0 dac 1 → joint2.current_command 68 $44 0100 0100 $C0A0=4 $C0A1=4 4.000 V 0.400 A"
        )
        # Bits 10 of channel 1 are counter-clockwise (table 1 of the paper).
        line = " ".join(line_of(app, "joint2.direction").split())
        assert line.startswith("3 $C0B0 latch 1 → joint2.direction 2 $02 10 $C0B0.1-0=10 – counter-clockwise")
        # Code 7 of the 8th cycle: 7 * 5 V / 255, and (7 - 127.5) * 270 / 255 degrees.
        line = " ".join(line_of(app, "joint2.potentiometer").split())
        assert line.startswith("4 $C0C0 adc 1 ← joint2.potentiometer 7 $07 0000 0111 $C0C9=07 0.137 V -127.588 °")


async def test_the_memory_is_shown_with_its_play_position(app, port):
    async with app.run_test(size=(120, 50)) as pilot:
        await running(app, port, pilot, 300)
        assert "memory: sample 299 of 4096, cycle 299" in line_of(app, "memory")
        lines = screen_lines(app)
        place = next(number for number, line in enumerate(lines) if line.startswith(" $4000 position joint2"))
        assert "▼" in lines[place]
        # Codes are the cycle's lower eight bits: 299 & 0xFF is 0x2B, at $4000 + 299, and nothing is known behind it.
        rows = {line.split(":")[0].strip(): line for line in lines[place + 1 :] if line.startswith("   $4")}
        begin = max(address for address in rows if address <= "$412B")
        sample = 0x412B - int(begin[1:], 16)
        shown = rows[begin].split(":")[1].split()
        assert (shown[sample - 1], shown[sample], shown[sample + 1]) == ("2A", "2B", "··")


@pytest.mark.parametrize(("size", "empty"), [((80, 24), 0), ((120, 35), 4), ((160, 48), 4), ((200, 60), 4)])
async def test_the_memory_has_the_room_that_the_table_leaves(app, port, size, empty):
    """Four pages have as many lines each, so at most three lines are left, and one below the border."""
    async with app.run_test(size=size) as pilot:
        await running(app, port, pilot, 600)
        await shown(app, pilot)
        region = app.query_one("#pane-cards").region
        lines = screen_lines(app)[region.y : region.bottom]
        assert sum(not line.strip() for line in lines) <= empty
        for page in (
            "$4000 position joint2",
            "$6000 velocity joint2",
            "$5000 position joint3",
            "$7000 velocity joint3",
        ):
            assert any(page in line and "▼" in line for line in lines)
        assert sum("_" in line or "." in line for line in lines) >= 10, "no row of the table went for it"


async def test_at_80_columns_the_registers_of_the_chosen_row_are_shown(app, port):
    async with app.run_test(size=(80, 24)) as pilot:
        await running(app, port, pilot)
        await pilot.press("home")
        await shown(app, pilot)
        assert line_of(app, "$C0A0=4").strip() == "joint2.current_command │ dac │ bits 0100 0100 │ $C0A0=4 $C0A1=4"
        await pilot.press("end")
        await shown(app, pilot)
        assert "joint3.current_sense │ adc" in line_of(app, "$C0C9")


async def test_without_frames_nothing_is_made_up(app):
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("5")
        await shown(app, pilot)
        assert line_of(app, "joint2.current_command").split()[-1] == "–"
        assert "memory: no run is followed" in line_of(app, "memory")


async def test_short_frames_are_no_codes(app, port):
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("5")
        port.arriving = [(0, frame("312#00")), (0, frame("294#00490040803F803F"))]
        await shown(app, pilot)
        assert line_of(app, "joint2.current_command").split()[-1] == "–"
        assert "19.588 °" in line_of(app, "joint2.potentiometer")


async def test_nothing_is_driven_before_the_cards_are_taken_in_hand_and_that_is_asked(app, port, hand):
    async with app.run_test(size=(120, 40)) as pilot:
        await running(app, port, pilot)
        for key in ("plus", "d", "s", "0", "j"):
            await pilot.press(key)
        await shown(app, pilot)
        assert "the cards are not in hand; t takes them" in line_of(app, "not in hand")
        await pilot.press("t", "n")
        assert (hand.told, hand.state) == ([], HandState.OFF)
        await pilot.press("t", "enter")
        await shown(app, pilot)
        assert hand.state is HandState.READY
        assert "✋ by hand, ready" in line_of(app, "✋")
        assert "cards are in OPERATIONAL" in line_of(app, "OPERATIONAL")
    assert hand.told == ["close"], "the cards are left safe"


async def test_keys_are_commands_of_the_jog(app, port, hand):
    async with app.run_test(size=(120, 40)) as pilot:
        await running(app, port, pilot)
        await pilot.press("t", "enter", "home", "plus", "right_square_bracket", "minus", "d", "d", "s", "S", "0")
        assert hand.told == [
            "dac joint2 1", "dac joint2 17", "dac joint2 16", "dir joint2 ccw", "dir joint2 cw", "step 1", "step 10",
            "off",
        ]  # fmt: skip
        await shown(app, pilot)
        # The bus has code 68; the commanded one acts at the next step.
        assert "68 $44 ▸16" in " ".join(line_of(app, "joint2.current_command").split())
        await pilot.press("j")
        app.query_one("#hand-command", Input).value = "current joint2 0.3; step 10; read"
        await pilot.press("enter")
        assert hand.told[-1] == "current joint2 0.3; step 10; read"
        assert app.focused.id == "cards"
        await pilot.press("t")
        assert hand.state is HandState.OFF


async def test_all_of_the_help_by_hand_can_be_read_line_by_line(app, port, hand):
    async with app.run_test(size=(80, 24)) as pilot:
        await running(app, port, pilot)
        await pilot.press("t", "enter", "j", *"help", "enter")
        await pilot.pause()
        lines = [line.strip("│ ") for line in screen_lines(app)]
        assert lines.index("all inputs") == lines.index("read") + 1
        assert not any("\\n" in line for line in lines)
        await pilot.press("end")
        await pilot.pause()
        assert "command 13" in "\n".join(screen_lines(app))
        await pilot.press("escape")
        assert hand.told == []


async def test_codes_stay_within_the_converter_and_inputs_cannot_be_set(app, port, hand):
    async with app.run_test(size=(120, 40)) as pilot:
        await running(app, port, pilot)
        await pilot.press("t", "enter", "home", "minus")
        assert hand.told == ["dac joint2 0"]
        hand.codes = (250, 0)
        await pilot.press("right_square_bracket")
        assert hand.told[-1] == "dac joint2 255"
        await pilot.press("end", "plus")
        await shown(app, pilot)
        assert "choose a row with →, an output, first" in line_of(app, "choose a row")


async def test_where_the_robots_bus_is_not_known_it_says_so(cell, bench_port, clock, watch):
    app = DashboardApp(cell, lambda: bench_port, clock_ns=clock, in_background=at_once, bus=watch)
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("5", "t")
        await shown(app, pilot)
        assert "cannot be driven from here" in line_of(app, "cannot be driven")


@pytest.mark.parametrize("size", [(1, 1), (10, 3)], ids="{0[0]}x{0[1]}".format)
async def test_terminals_of_any_size_are_borne(app, port, size):
    async with app.run_test(size=size) as pilot:
        await running(app, port, pilot)
        assert len(app.query_one("#cards", Grid).rows) == 10
