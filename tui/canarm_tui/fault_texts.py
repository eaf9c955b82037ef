"""The dashboard's texts about faults and detections: the lines of the panel, as words with a tone. Pure functions."""

from collections.abc import Iterable, Iterator, Sequence

from canarm_protocol.faults.fault_events import FaultEvent, fault_label

from .event_texts import Line, event_line, when
from .events import Happening
from .fault_desk import Refusal
from .faults import ActingFault, Faults, FaultSignal
from .texts import Tone, Word

MOST_ACTING = 4
MOST_EVENTS = 3
MOST_NAMES = 4
MORE_THAN_A_BYTE = 255


def panel_lines(
    signal: FaultSignal | None,
    faults: Faults | None,
    refusal: Refusal | None,
    happened: Sequence[Happening],
    cycle_s: float,
    cycle: int | None = None,
) -> tuple[Line, ...]:
    """The panel: nothing before the first fault or detection, then what acts and for how long yet, what waits, and the
    last of what has `happened`, which is newest first. `cycle` is the present one.
    """
    if signal is None:
        return ()
    faults = faults or Faults()
    if not (signal.active or signal.begun or signal.detections or faults.waiting or faults.stops):
        return ()
    return (
        _summary(signal, faults, refusal),
        *_acting_lines(faults, cycle_s, cycle),
        *_waiting_lines(faults),
        *_event_lines(happened[:MOST_EVENTS], cycle_s),
    )


def _event_lines(happened: Iterable[Happening], cycle_s: float) -> Iterator[Line]:
    for each in happened:
        first, *rest = event_line(each, cycle_s)
        yield Word(f"  {first.text}", first.tone), *rest


def answer_word(answer: str | Refusal) -> Word:
    """The answer of the bench, or the bus, to a request."""
    return Word(f"✖ {answer.reason}", Tone.BAD) if isinstance(answer, Refusal) else Word(f"✓ {answer}", Tone.GOOD)


def _summary(signal: FaultSignal, faults: Faults, refusal: Refusal | None) -> Line:
    count = "255 or more" if signal.active == MORE_THAN_A_BYTE else str(signal.active)
    acting = Word("no fault acts", Tone.DIM)
    if signal.active:
        acting = Word(f"▲ {count} {'fault acts' if signal.active == 1 else 'faults act'}", Tone.WARNING)
    words = [acting]
    if faults.waiting:
        words.append(Word(f"○ {len(faults.waiting)} {'set waits' if len(faults.waiting) == 1 else 'sets wait'}"))
    words.append(Word(f"begun so far {signal.begun}", Tone.DIM))
    if signal.detections:
        words.append(Word(f"◆ detected so far {signal.detections}", Tone.GOOD))
    return *words, *_refusal_words(refusal)


def _refusal_words(refusal: Refusal | None) -> Line:
    return () if refusal is None else (Word(f"▲ not up to date: {refusal.reason}", Tone.WARNING),)


def _acting_lines(faults: Faults, cycle_s: float, cycle: int | None) -> Iterator[Line]:
    acting = faults.acting
    shown = acting if len(acting) <= MOST_ACTING else acting[: MOST_ACTING - 1]
    for each in shown:
        since = "" if each.began is None else f", since {_since(each.began, faults.begin_ns, cycle_s)}"
        yield (Word(f"  ▲ {_what(each)}{since}{_left(each, faults, cycle_s, cycle)}", Tone.WARNING),)
    if len(shown) < len(acting):
        yield (Word(f"  ▲ and {len(acting) - len(shown)} more", Tone.WARNING),)


def _since(began: FaultEvent, begin_ns: int, cycle_s: float) -> str:
    return when(began, cycle_s, began.time_ns < begin_ns)


def _left(each: ActingFault, faults: Faults, cycle_s: float, cycle: int | None) -> str:
    """For how long it acts yet, as far as that is known, and which time of several this is."""
    plan, began = faults.plans.get(each.set_name), each.began
    if plan is None:
        return ""
    turn = f", {plan.activations} of {plan.repeat}" if plan.repeat > 1 else ""
    if plan.duration_s is None:
        return f", until it is cleared{turn}"
    if began is None or cycle is None or began.cycle < 0 or began.time_ns < faults.begin_ns:
        return f", {plan.duration_s:g} s in all{turn}"
    return f", {max(plan.duration_s - (cycle - began.cycle) * cycle_s, 0.0):.1f} s more{turn}"


def _waiting_lines(faults: Faults) -> Iterator[Line]:
    waiting = faults.waiting
    if waiting:
        more = f" and {len(waiting) - MOST_NAMES} more" if len(waiting) > MOST_NAMES else ""
        yield (Word(f"  ○ waiting: {', '.join(_awaited(name, faults) for name in waiting[:MOST_NAMES])}{more}"),)


def _awaited(name: str, faults: Faults) -> str:
    trigger = faults.plans[name].trigger if name in faults.plans else ""
    return f"{name} ({trigger})" if trigger else name


def _what(each: ActingFault) -> str:
    return fault_label(each.set_name, each.tap, each.fault)
