"""The dialog that injects a fault: a tap, a fault that it supports, values for the parameters, and when it acts.

Asks `FaultDesk` and shows its answers unchanged; what is allowed is not known here.
"""

from collections.abc import Callable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.widget import Widget
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from .dialog import Dialog
from .fault_catalogue import SCHEDULE, WHEN, FaultKind, Tap, matching
from .fault_desk import FaultDesk, Refusal
from .styles import STYLES
from .texts import Tone

_KEYS = "type to find │ ↑ ↓ choose │ enter goes on │ escape goes back"
_FORM_KEYS = "↑ ↓ next field │ enter injects │ escape goes back"


class InjectScreen(Dialog[str]):
    """Ends with the bench's answer, or None if the user cancels."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "back", "Back"),
        Binding("up", "move(-1)", "Up", show=False, priority=True),
        Binding("down", "move(1)", "Down", show=False, priority=True),
    ]
    DEFAULT_CSS = """
    InjectScreen .dialog { width: 100; height: 22; }
    InjectScreen OptionList { height: 1fr; border: none; padding: 0; text-wrap: nowrap; text-overflow: ellipsis; }
    InjectScreen #form { height: 1fr; display: none; }
    InjectScreen.-form #form { display: block; }
    InjectScreen.-form #search { display: none; }
    InjectScreen.-form OptionList { display: none; }
    InjectScreen Horizontal { height: auto; }
    InjectScreen Horizontal .name { width: 22; }
    InjectScreen Horizontal Input { width: 16; }
    InjectScreen Horizontal .hint { width: 1fr; padding-left: 1; color: $foreground 60%; }
    InjectScreen Horizontal .long { width: 1fr; }
    InjectScreen .heading { color: $text-primary; }
    InjectScreen #about { height: auto; color: $foreground 60%; }
    InjectScreen #said { height: auto; max-height: 6; }
    """

    def __init__(self, desk: FaultDesk, remark: Callable[[], str] = str, refusal: Callable[[], str] = str) -> None:
        """What `remark` says now stands below while there is nothing else to say; `refusal` is why nothing is injected
        now.
        """
        super().__init__()
        self._desk, self._remark, self._refusal = desk, remark, refusal
        self._taps: tuple[Tap, ...] = ()
        self._tap: Tap | None = None
        self._fault: FaultKind | None = None
        self._shown: tuple[Tap, ...] | tuple[FaultKind, ...] = ()
        self._said = self._remarked = ""
        self._is_asking, self._is_loading = False, True
        self._is_entered = False
        """Enter has come before there was anything to choose from."""

    def holds(self, key: str) -> bool:
        """What is typed behind an early enter waits for the bench's answer."""
        return super().holds(key) or (self._is_entered and key != "escape")

    def compose(self) -> ComposeResult:
        """Search and list, or the form; below them the bench's answer."""
        with Vertical(id="dialog", classes="dialog"):
            yield Input(id="search", compact=True, placeholder="part of a name, such as joint2 stuck")
            options = OptionList(id="choices")
            options.can_focus = False
            yield options
            yield VerticalScroll(id="form", can_focus=False)
            yield Static(id="about")
            yield Static(id="said")

    def on_mount(self) -> None:
        """Ask what can be injected."""
        self._show_list()
        self._say("… asking the bench what can be injected", Tone.DIM)
        self._desk.load_catalogue(self.while_open(self._take_catalogue))

    def on_input_changed(self, event: Input.Changed) -> None:
        """Search while typing."""
        if event.input.id == "search" and self.is_there:
            self._fill()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Enter: go on, or inject."""
        if not self.is_there:
            return
        highlighted = self.query_one(OptionList).highlighted
        if event.input.id != "search":
            self._inject()
        elif highlighted is not None:
            self._choose(highlighted)
        elif self._is_loading:
            self._is_entered = True

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """A click goes on as well."""
        if self.is_there:
            self._choose(event.option_index)

    def action_back(self) -> None:
        """Back from the values to the faults, to the taps, and out."""
        if self._fault is not None:
            self._fault = None
        elif self._tap is not None:
            self._tap = None
        else:
            self.dismiss()
            return
        self._say("", Tone.PLAIN)
        self._show_list()

    def action_move(self, step: int) -> None:
        """The next line of the list, or the next field."""
        if self._fault is not None:
            if step > 0:
                self.focus_next(Input)
            else:
                self.focus_previous(Input)
        elif step > 0:
            self.query_one(OptionList).action_cursor_down()
        else:
            self.query_one(OptionList).action_cursor_up()

    def _take_catalogue(self, answer: tuple[Tap, ...] | Refusal) -> None:
        is_entered, self._is_entered, self._is_loading = self._is_entered, False, False
        if isinstance(answer, Refusal):
            self._say(answer.reason, Tone.BAD)
        else:
            self._say_remark()
            self._taps = answer
            self._fill()
            if is_entered and self._shown:
                self._choose(0)
        self.take_keys()

    def _choose(self, index: int) -> None:
        chosen = self._shown[index]
        if isinstance(chosen, Tap):
            self._tap = chosen
            self._show_list()
        else:
            self._fault = chosen
            self.call_later(self._show_form, chosen)

    def _show_list(self) -> None:
        self.set_class(False, "-form")
        dialog = self.query_one("#dialog")
        dialog.border_title = Content(
            "Inject a fault: where?" if self._tap is None else f"{self._tap.name}: which fault?"
        )
        dialog.border_subtitle = _KEYS
        self.query_one("#about", Static).update(Content("" if self._tap is None else self._tap.about))
        search = self.query_one("#search", Input)
        search.value = ""
        search.focus()
        self._fill()

    def _fill(self) -> None:
        typed = self.query_one("#search", Input).value
        self._shown = matching(self._taps, typed) if self._tap is None else matching(self._tap.faults, typed)
        options = self.query_one(OptionList)
        options.clear_options()
        options.add_options([Option(_line(each)) for each in self._shown])
        if self._shown:
            options.highlighted = 0
        if self._taps:
            if self._shown:
                self._say_remark()
            else:
                self._say("nothing is called so; fewer letters find more", Tone.WARNING)

    async def _show_form(self, fault: FaultKind) -> None:
        if self._tap is None or not self.is_there:
            return  # escape was quicker
        form, dialog = self.query_one("#form", VerticalScroll), self.query_one("#dialog")
        await form.remove_children()
        rows = [(each.name, each.default, f"{each.bounds}: {each.about}") for each in fault.parameters]
        fields = [Input(value, name=name, compact=True, select_on_focus=False) for name, value, _ in rows]
        lines: list[Widget] = [_field_line(field, hint) for field, (_, _, hint) in zip(fields, rows, strict=True)]
        lines.append(Static("when it acts", classes="heading"))
        for name, hint in SCHEDULE.items():
            is_text = name == WHEN
            field = Input(name=name, compact=True, classes="long" * is_text, placeholder=hint * is_text)
            fields.append(field)
            lines.append(_field_line(field, "" if is_text else hint))
        await form.mount_all(lines)
        dialog.border_title, dialog.border_subtitle = Content(f"{self._tap.name} {fault.name}"), _FORM_KEYS
        self.query_one("#about", Static).update(Content(_about(fault)))
        self.set_class(True, "-form")
        fields[0].focus()

    def _inject(self) -> None:
        if self._tap is None or self._fault is None or self._is_asking:
            return
        if refusal := self._refusal():
            self._say(refusal, Tone.BAD)
            return
        fields = list(self.query_one("#form").query(Input))
        all_of_it = [(field.name or "", field.value) for field in fields]
        typed, schedule = dict(all_of_it[: -len(SCHEDULE)]), dict(all_of_it[-len(SCHEDULE) :])
        self._is_asking = True
        self._say("… asking the bench", Tone.DIM)
        self._desk.inject(self._tap.name, self._fault, typed, schedule, self.while_open(self._take_answer))

    def _take_answer(self, answer: str | Refusal) -> None:
        self._is_asking = False
        if isinstance(answer, Refusal):
            self._say(answer.reason, Tone.BAD)
        else:
            self.dismiss(answer)

    def _say_remark(self) -> None:
        self._say(self._remark(), Tone.WARNING)
        self._remarked = self._said

    def renew_remark(self) -> None:
        """Say the remark as it is now, where it stands."""
        if self.is_there and self._taps and self._said == self._remarked != self._remark():
            self._say_remark()

    def _say(self, text: str, tone: Tone) -> None:
        self._said = text
        self.query_one("#said", Static).update(Content.styled(text, STYLES[tone]))


def _field_line(field: Input, hint: str) -> Horizontal:
    hints = [Static(Content(hint), classes="hint")] if hint else []
    return Horizontal(Static(Content(field.name or ""), classes="name"), field, *hints)


def _about(fault: FaultKind) -> str:
    return fault.about + (" Needs an emulator with --wire." if fault.needs_wire else "")


def _line(each: Tap | FaultKind) -> Content:
    about = _about(each) if isinstance(each, FaultKind) else each.about
    return Content.assemble(f"{each.name:<24} ", (about, STYLES[Tone.DIM]))
