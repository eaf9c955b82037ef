"""Declarations of faults in TOML: what they mean, and every way to get one wrong."""

import pytest

from canarm_protocol.errors import FaultError
from canarm_protocol.faults import (
    LARGEST_TEXT,
    MOST_FAULTS,
    MOST_SETS,
    FaultScript,
    FaultSet,
    FaultSpec,
    Trigger,
    parse_faults,
    script_of,
)

ONE = """
[[set]]
name = "tachometer dies"
at = 1.0
duration = 0.5

[[set.fault]]
tap = "joint2.tachometer"
fault = "stuck"
value = 2.5
"""


def refusal(text: str) -> str:
    with pytest.raises(FaultError) as caught:
        parse_faults(text, "f.toml")
    message = str(caught.value)
    assert "\n" not in message
    return message


def refusal_of_set(lines: str) -> str:
    return refusal("[[set]]\n" + lines)


def only_set(lines: str) -> FaultSet:
    script = parse_faults("[[set]]\n" + lines)
    assert len(script.sets) == 1
    return script.sets[0]


def test_a_set_has_a_name_a_trigger_a_duration_and_faults_with_their_parameters() -> None:
    spec = FaultSpec("joint2.tachometer", "stuck", {"value": 2.5})
    assert parse_faults(ONE) == FaultScript((FaultSet("tachometer dies", (spec,), Trigger(at_s=1.0), 0.5),))


@pytest.mark.parametrize(
    ("line", "trigger"),
    [
        ("at = 0", Trigger(at_s=0.0)),
        ("at = 1.5", Trigger(at_s=1.5)),
        ("cycle = 400", Trigger(cycle=400)),
        ("cycle = 0", Trigger(cycle=0)),
        ('when = "time_s > 1"', Trigger(when="time_s > 1")),
        ("manual = true", Trigger(is_manual=True)),
        ("manual = false", Trigger()),
        ("", Trigger()),
    ],
)
def test_a_set_has_one_trigger_or_none(line: str, trigger: Trigger) -> None:
    assert only_set(line).trigger == trigger


def test_a_set_may_come_again() -> None:
    repeated = only_set("duration = 0.1\nrepeat = 3\nperiod = 0.4")
    assert (repeated.duration_s, repeated.repeat, repeated.period_s) == (0.1, 3, 0.4)
    assert (only_set("").duration_s, only_set("").repeat, only_set("").period_s) == (None, 1, None)


def test_sets_without_a_name_are_numbered_and_keep_their_order() -> None:
    script = parse_faults('[[set]]\n[[set]]\nname = "b"\n[[set]]\n')
    assert [each.name for each in script.sets] == ["set 1", "b", "set 3"]
    assert not script.is_parallel


def test_sets_may_run_side_by_side() -> None:
    assert parse_faults("parallel = true\n[[set]]\n").is_parallel


@pytest.mark.parametrize("text", ["", "# nothing\n", "clear = true"])
def test_a_text_without_sets_clears_all(text: str) -> None:
    assert parse_faults(text) == FaultScript(clear="")


def test_one_set_can_be_cleared_or_triggered_by_name() -> None:
    assert parse_faults('clear = "a"') == FaultScript(clear="a")
    assert parse_faults('trigger = "a"') == FaultScript(trigger="a")


def test_parameters_are_numbers_texts_or_switches() -> None:
    spec = only_set('[[set.fault]]\ntap = "t"\nfault = "f"\na = 1\nb = 2.5\nc = "x"\nd = true').faults[0]
    assert spec.parameters == {"a": 1, "b": 2.5, "c": "x", "d": True}


def test_a_parsed_table_is_read_as_its_text_is() -> None:
    table = {"set": [{"name": "a", "fault": [{"tap": "t", "fault": "f", "value": 1}]}]}
    assert script_of(table) == FaultScript((FaultSet("a", (FaultSpec("t", "f", {"value": 1}),)),))


# What is refused


def test_text_that_is_not_toml_is_refused_in_one_line() -> None:
    assert refusal("[[set]\n").startswith("f.toml: not valid TOML: ")
    assert refusal("a = " + "[" * 10_000).startswith("f.toml: not valid TOML: ")


def test_a_text_that_is_too_long_is_refused() -> None:
    assert refusal("#" * (LARGEST_TEXT + 1)) == "f.toml: 100001 characters; must have at most 100000"


def test_too_many_sets_are_refused() -> None:
    assert len(parse_faults("[[set]]\n" * MOST_SETS).sets) == 1000
    assert refusal("[[set]]\n" * (MOST_SETS + 1)) == "f.toml: 1001 sets; must be at most 1000"


def test_too_many_faults_of_a_set_are_refused() -> None:
    fault = '[[set.fault]]\ntap = "t"\nfault = "f"\n'
    assert len(only_set(fault * MOST_FAULTS).faults) == 100
    assert refusal_of_set(fault * (MOST_FAULTS + 1)) == "f.toml: set 1: 101 faults; must be at most 100"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("paralel = true", "f.toml: unknown key 'paralel'; did you mean 'parallel'?"),
        ("parallel = 1", "f.toml: parallel = 1: must be true or false"),
        ("clear = false", "f.toml: clear = False: must be the name of a set"),
        ("clear = 3", "f.toml: clear = 3: must be the name of a set"),
        ("trigger = true", "f.toml: trigger = True: must be the name of a set"),
        ("set = 3", "f.toml: 'set' must be tables, each headed [[set]]"),
        ("set = [1]", "f.toml: 'set' must be tables, each headed [[set]]"),
        ("[set]", "f.toml: 'set' must be tables, each headed [[set]]"),
        ('clear = "a"\n[[set]]', "f.toml: 'clear' and 'trigger' stand alone; sets go into a text of their own"),
        ('trigger = "a"\n[[set]]', "f.toml: 'clear' and 'trigger' stand alone; sets go into a text of their own"),
        ('[[set]]\nname = "a"\n[[set]]\nname = "a"', "f.toml: 2 sets are named 'a'; names must differ"),
        ('[[set]]\n[[set]]\nname = "set 1"', "f.toml: 2 sets are named 'set 1'; names must differ"),
        ('[[set]]\n[[set]]\nname = "b"\nat = -1', "f.toml: set 2 ('b'): at = -1: must be a number of seconds"),
    ],
)
def test_a_wrong_script_is_refused(text: str, message: str) -> None:
    assert refusal(text).startswith(message)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("durations = 1", "unknown key 'durations'; did you mean 'duration'?"),
        ("name = 3", "name = 3: must be text of at most 80 characters"),
        ('name = ""', "name = '': must be text of at most 80 characters"),
        ('name = "a\\nb"', "name = 'a\\nb': must be text of at most 80 characters"),
        (f'name = "{"a" * 81}"', f"name = '{'a' * 81}': must be text of at most 80 characters"),
        ("at = 1\ncycle = 3", "has at and cycle; must have one trigger: at, cycle, when, manual"),
        ("at = -0.1", "at = -0.1: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = 1e7", "at = 10000000.0: must be a number of seconds, at least 0, at most 1e+06"),
        (f"at = 1{'0' * 400}", f"at = 1{'0' * 400}: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = nan", "at = nan: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = inf", "at = inf: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = true", "at = True: must be a number of seconds, at least 0, at most 1e+06"),
        ('at = "1"', "at = '1': must be a number of seconds, at least 0, at most 1e+06"),
        ("duration = 0", "duration = 0: must be a number of seconds, greater than 0, at most 1e+06"),
        ("period = -1", "period = -1: must be a number of seconds, greater than 0, at most 1e+06"),
        ("cycle = -1", "cycle = -1: must be a whole number, at least 0"),
        ("cycle = 1.5", "cycle = 1.5: must be a whole number, at least 0"),
        ("cycle = true", "cycle = True: must be a whole number, at least 0"),
        ("cycle = 2147483648", "cycle = 2147483648: must be a whole number, at least 0"),
        ("repeat = 0\nduration = 1", "repeat = 0: must be a whole number, at least 1"),
        ("when = 3", 'when = 3: must be text, such as "joint2.angle_deg > 30"'),
        ("manual = 1", "manual = 1: must be true or false"),
        ("repeat = 2", "repeat = 2: needs a duration, after which the faults end and come again"),
        (
            "repeat = 2\nduration = 0.5\nperiod = 0.5",
            "period = 0.5: must be longer than the duration, 0.5 s",
        ),
        ("fault = 3", "'fault' must be tables, each headed [[set.fault]]"),
    ],
)
def test_a_wrong_set_is_refused_with_its_place(lines: str, message: str) -> None:
    assert refusal_of_set(lines) == f"f.toml: set 1: {message}"


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('fault = "f"', 'must have tap = "..."; see `canarm fault list`'),
        ('tap = "t"', 'must have fault = "..."; see `canarm fault list`'),
        ('tap = 3\nfault = "f"', 'must have tap = "..."; see `canarm fault list`'),
        ('tap = "t"\nfault = "f"\nvalue = [1]', "value = [1]: must be a number, a text, or true or false"),
        ('tap = "t"\nfault = "f"\nvalue = {a = 1}', "value = {'a': 1}: must be a number, a text, or true or false"),
    ],
)
def test_a_wrong_fault_is_refused_with_its_place(lines: str, message: str) -> None:
    assert refusal(f'[[set]]\nname = "n"\n[[set.fault]]\n{lines}') == f"f.toml: set 1 ('n'), fault 1: {message}"
