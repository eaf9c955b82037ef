"""The view of the joints: their values in a table, below it traces over time and a picture of the arms."""

from typing import ClassVar

import numpy as np
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.events import Resize

from canarm_protocol.cell.bench_objects import INTERNALS
from canarm_protocol.cell.model import Cell

from .arm_drawing import Pose
from .arm_picture import ArmPicture
from .history import Column
from .joints_table import JointsTable
from .signals import Signal, signals_of
from .snapshot import Snapshot
from .timeline import Extent, Timeline
from .trace import Trace
from .traces import Traces
from .views import Context, Pane, Scene, View

BOTH_FROM_COLUMNS = 100
"""Below, there is room for traces or picture."""
TWO_SIGNALS_FROM, THREE_SIGNALS_FROM = 150, 200
WINDOW_S = 10.0
TABLE_NS = 100_000_000
"""Nobody reads numbers that change more often; lines may."""
TRAIL_S = 3.0
TRAIL_POSES = 60


class JointsPane(Pane):
    """Values, traces, picture; what is shown of them is chosen by keys."""

    DEFAULT_CSS = """
    JointsPane #below { height: 1fr; }
    JointsPane ArmPicture { width: 40; }
    JointsPane.-wide ArmPicture { width: 48; }
    JointsPane.-narrow ArmPicture { width: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "t", "signal(1)", "Trace", id="traces.signal", tooltip="Next signal: error, angle, current, speed, law"
        ),
        Binding("p", "picture", "Arm", id="traces.picture", tooltip="The picture of the arms, or more room for traces"),
        Binding(
            "c", "cursor", "Cursor", id="traces.cursor", show=False, tooltip="A cursor with values; the arrows move it"
        ),
        Binding("o", "overlay", "Over", id="traces.overlay", show=False, tooltip="Two joints over each other"),
        Binding("a", "inner", "Law value", id="traces.inner", show=False, tooltip="Next one of the law's own values"),
        Binding("v", "turn", "Turn", id="traces.turn", show=False, tooltip="The arms from another side"),
        Binding("T", "signal(-1)", "Signal before", id="traces.before", show=False),
        Binding("plus,equals_sign", "zoom(True)", "Closer", id="traces.closer", show=False),
        Binding("minus", "zoom(False)", "Further", id="traces.further", show=False),
        Binding("left", "move(-1)", "Earlier", id="traces.earlier", show=False),
        Binding("right", "move(1)", "Later", id="traces.later", show=False),
        Binding("pageup", "page(-2)", "A page earlier", id="traces.page_earlier", show=False),
        Binding("pagedown", "page(2)", "A page later", id="traces.page_later", show=False),
        Binding("home", "oldest", "Oldest", id="traces.oldest", show=False),
        Binding("end", "newest", "Newest", id="traces.newest", show=False),
    ]

    def __init__(self, cell: Cell) -> None:
        super().__init__()
        self._cell, self._count = cell, len(cell.joint_names)
        self.timeline = Timeline(max(1, round(WINDOW_S / cell.bus.cycle_s)))
        """What the traces show."""
        self._scene = Scene(Snapshot(joints=()))
        self._signal = self._inner = self._joint = 0
        self._is_over = self._is_swapped = False
        self._columns = 1
        self._table_ns = 0

    def compose(self) -> ComposeResult:
        """The table, traces and picture."""
        yield JointsTable(self._cell.joint_names)
        with Horizontal(id="below"):
            yield Traces(self._cell)
            yield ArmPicture(self._cell)

    def on_resize(self, event: Resize) -> None:
        """Traces, picture or both, and as many signals as there is room for."""
        self._set_out()

    def on_joints_table_chosen(self, event: JointsTable.Chosen) -> None:
        """The chosen joint is the one that is looked at."""
        self._joint = event.joint
        self._set_out()
        self.query_one(Traces).reveal(self._joint)

    def on_trace_pointed(self, event: Trace.Pointed) -> None:
        """A click sets the cursor."""
        self._go(self.timeline.pointed(self._extent, event.cycle))

    def show(self, scene: Scene) -> None:
        """Show `scene`."""
        self._scene = scene
        self._draw()

    def jump(self, cycle: int) -> bool:
        """Put the cursor on `cycle`; False if that is no longer kept, and the nearest that is is shown."""
        extent = self._extent
        self._go(self.timeline.at(extent, cycle))
        return extent.first <= cycle <= extent.last

    def action_signal(self, step: int) -> None:
        """Another signal."""
        self._signal += step
        self._draw()

    def action_inner(self) -> None:
        """Another one of the law's own values."""
        self._inner = (self._inner + 1) % len(self._inner_names)
        self._draw()

    def action_picture(self) -> None:
        """The picture comes or goes."""
        self._is_swapped = not self._is_swapped
        self._set_out()

    def action_turn(self) -> None:
        """The arms from another side."""
        self.query_one(ArmPicture).turn()

    def action_overlay(self) -> None:
        """The joint of the table's cursor and the next one over each other, or all of them again."""
        self._is_over = self._count > 1 and not self._is_over
        self._set_out()

    def action_cursor(self) -> None:
        """Set or take away the cursor."""
        self._go(self.timeline.with_cursor(self._extent))

    def action_zoom(self, is_in: bool) -> None:
        """Half or twice as much time."""
        self._go(self.timeline.zoomed(self._extent, is_in))

    def action_move(self, steps: int) -> None:
        """Move the cursor, or scroll without one."""
        moved = self.timeline.cursor is not None
        self._go(self.timeline.moved(self._extent, steps) if moved else self.timeline.scrolled(self._extent, steps))

    def action_page(self, pages: int) -> None:
        """Scroll."""
        self._go(self.timeline.scrolled(self._extent, pages))

    def action_oldest(self) -> None:
        """The beginning of what is kept."""
        self._go(self.timeline.oldest(self._extent))

    def action_newest(self) -> None:
        """Follow what comes."""
        self._go(self.timeline.following())

    def _go(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self._draw()

    @property
    def _extent(self) -> Extent:
        cycles = self._scene.snapshot.history.cycles
        return Extent(int(cycles[0]), int(cycles[-1])) if len(cycles) else Extent(0, 0)

    @property
    def _inner_names(self) -> tuple[str, ...]:
        named = tuple(name for name in self._scene.snapshot.internal_names if name)
        return named or tuple(f"law value {place + 1}" for place in range(INTERNALS))

    @property
    def _signals(self) -> list[Signal]:
        signals = signals_of(self._inner_names, self._inner)
        return [signals[(self._signal + place) % len(signals)] for place in range(self._columns)]

    def _set_out(self) -> None:
        width = self.app.size.width
        is_narrow = width < BOTH_FROM_COLUMNS
        self.set_class(is_narrow, "-narrow")
        self.set_class(width >= TWO_SIGNALS_FROM, "-wide")
        has_picture = self._is_swapped == is_narrow
        self.query_one(ArmPicture).display = has_picture
        traces = self.query_one(Traces)
        traces.display = not (is_narrow and has_picture)
        self._columns = 1 + (width >= TWO_SIGNALS_FROM) + (width >= THREE_SIGNALS_FROM)
        traces.set_out(self._columns, self._joint, self._is_over)
        self._draw()

    def _draw(self) -> None:
        snapshot, names = self._scene.snapshot, self._inner_names
        if not snapshot.joints:
            return
        self._inner %= len(names)
        extent, timeline = self._extent, self.timeline
        if timeline.end is not None and timeline.end > extent.last:
            self.timeline = timeline = timeline.following()
        elif timeline.end is not None and timeline.end < extent.first:
            self.timeline = timeline = timeline.oldest(extent)
        if not 0 < self._scene.now_ns - self._table_ns < TABLE_NS:
            self._table_ns = self._scene.now_ns
            self.query_one(JointsTable).show(snapshot.joints, self._inner, names[self._inner])
        over = (self._joint, (self._joint + 1) % self._count) if self._is_over else None
        traces, picture = self.query_one(Traces), self.query_one(ArmPicture)
        if traces.display:
            traces.show(snapshot, timeline, timeline.bounds(extent), self._signals, self._scene.happened, over)
        if picture.display:
            picture.show(self._pose(snapshot, extent))

    def _pose(self, snapshot: Snapshot, extent: Extent) -> Pose:
        """The arms now, or where the cursor or the end of what is looked at stands, and the way there."""
        history, timeline = snapshot.history, self.timeline
        at = timeline.cursor if timeline.cursor is not None else timeline.end
        last = extent.last if at is None else at
        rows = history.between(last - round(TRAIL_S / self._cell.bus.cycle_s), last)
        every = max(1, len(rows.cycles) // TRAIL_POSES)
        # Counted from the first one of all, so that the dots stand still while the window goes on.
        trail = (
            rows.values[:, :, Column.ANGLE][(-int(rows.cycles[0]) // 4) % every :: every]
            if len(rows.cycles)
            else rows.values[:, :, 0]
        )
        if at is None or not len(rows.cycles):
            true = np.array([joint.angle_rad for joint in snapshot.joints])
            reference = np.array([joint.reference_rad for joint in snapshot.joints])
        else:
            true, reference = (
                rows.values[-1, :, column].astype(np.float64) for column in (Column.ANGLE, Column.REFERENCE)
            )
        return Pose(true, reference, trail.astype(np.float64))


VIEW: View[Context] = View(
    name="joints",
    title="Joints",
    key="1",
    what="The joints: values, traces, a picture of the arms",
    make=lambda context: JointsPane(context.cell),
    help="""\
Angle, reference and error belong to the same cycle: the newest whose reference has arrived.
While no cycles come, the angle is the present one, without reference, error and measurement.
error          true angle minus reference, in steps (LSB) of the joint's position sensor
RMS            of the error over the last 10 s of the run
of limit       the motor's current against the amplifier's limit; ▲ and a sign: the command is at it, that way
DAC, turn      the code of the command, and the way in which the bridge is told to turn
▲ ◆ ○ ■ □      above a trace: a fault began, a detector answered, a fault ended; of this joint, or of none;
               the emergency stop was pressed, released
↑ ↓  choose a joint     t T  next signal, the one before     a  next one of the law's own values
← →  earlier, later     + −  closer, further                 home end  oldest, and follow the newest
c    cursor: values at a moment, moved by ← →; a click sets it
o    the chosen joint and the next one over each other
p    picture of the arms, true over reference, with the trail of the tip; v turns it
Two minutes of the run are kept. Times on the axis count from cycle 0.""",
)
