"""Declarations of faults in TOML: what they mean, and every way to get one wrong."""

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canarm_protocol.cell.cell_messages import nearest
from canarm_protocol.errors import FaultError
from canarm_protocol.faults.script import (
    LARGEST_TEXT,
    MOST_FAULTS,
    MOST_SETS,
    FaultScript,
    FaultSet,
    FaultSpec,
    Trigger,
    clearing,
    parse_faults,
    read_faults,
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


def test_one_set_can_be_cleared_or_triggered_by_name() -> None:
    assert parse_faults('clear = "a"') == FaultScript(clear="a") == clearing("a")
    assert parse_faults('clear = ""') == FaultScript(clear="") == clearing()
    assert parse_faults('trigger = "a"') == FaultScript(trigger="a")


def test_parameters_are_numbers_texts_or_switches() -> None:
    spec = only_set('[[set.fault]]\ntap = "t"\nfault = "f"\na = 1\nb = 2.5\nc = "x"\nd = true').faults[0]
    assert spec.parameters == {"a": 1, "b": 2.5, "c": "x", "d": True}


def test_a_parsed_table_is_read_as_its_text_is() -> None:
    table = {"set": [{"name": "a", "fault": [{"tap": "t", "fault": "f", "value": 1}]}]}
    assert script_of(table) == FaultScript((FaultSet("a", (FaultSpec("t", "f", {"value": 1}),)),))


@pytest.mark.parametrize("number", [np.int64(5), np.uint8(5), np.int32(5)])
def test_numpys_whole_numbers_are_whole_numbers(number: Any) -> None:
    spec = {"tap": "t", "fault": "f", "value": number}
    declared = script_of({"set": [{"cycle": number, "duration": number, "repeat": number, "fault": [spec]}]}).sets[0]
    assert (declared.trigger.cycle, declared.duration_s, declared.repeat) == (5, 5.0, 5)
    assert [type(each) for each in (declared.trigger.cycle, declared.repeat)] == [int, int]
    assert type(declared.faults[0].parameters["value"]) is int


@pytest.mark.parametrize("number", [np.float32(0.5), np.float64(0.5), Fraction(1, 2)])
def test_numpys_numbers_are_numbers(number: Any) -> None:
    spec = {"tap": "t", "fault": "f", "value": number}
    declared = script_of({"set": [{"at": number, "fault": [spec]}]}).sets[0]
    assert declared.trigger.at_s == declared.faults[0].parameters["value"] == 0.5
    assert type(declared.trigger.at_s) is type(declared.faults[0].parameters["value"]) is float


@pytest.mark.parametrize("key", ["at", "cycle"])
@pytest.mark.parametrize("value", [True, np.True_, np.array([1, 2])])
def test_what_is_no_number_is_refused_from_python_too(key: str, value: Any) -> None:
    with pytest.raises(FaultError, match=f"set 1: {key} = .*: must be a "):
        script_of({"set": [{key: value}]})


# Files


def test_a_fault_file_is_read_with_a_byte_order_mark_and_without(tmp_path: Path) -> None:
    for number, mark in enumerate((b"", b"\xef\xbb\xbf")):
        path = tmp_path / f"{number}.toml"
        path.write_bytes(mark + ONE.encode())
        assert read_faults(path) == parse_faults(ONE)


def refusal_of_file(path: Path) -> str:
    with pytest.raises(FaultError) as caught:
        read_faults(path)
    message = str(caught.value)
    assert "\n" not in message
    return message.removeprefix(f"fault file {path}: ")


def test_a_file_without_end_is_not_read() -> None:
    assert refusal_of_file(Path("/dev/zero")) == "is no regular file; a fault file is a TOML file"


def test_a_pipe_that_nobody_writes_to_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert refusal_of_file(tmp_path / "pipe") == "is no regular file; a fault file is a TOML file"


def test_a_file_that_cannot_be_read_is_refused_with_the_reason(tmp_path: Path) -> None:
    assert refusal_of_file(tmp_path / "none.toml") == "cannot be read: No such file or directory"
    (tmp_path / "latin.toml").write_bytes('[[set]]\nname = "fällt aus"\n'.encode("latin-1"))
    assert refusal_of_file(tmp_path / "latin.toml") == "is not a text in UTF-8; a fault file is a TOML file"
    (tmp_path / "large.toml").write_bytes(b"#" * (4 * LARGEST_TEXT + 1))
    assert refusal_of_file(tmp_path / "large.toml") == "is larger than 400000 bytes; is it a fault file?"


def test_a_file_of_as_many_characters_as_a_text_may_have_is_read_whatever_they_are(tmp_path: Path) -> None:
    path = tmp_path / "f.toml"
    path.write_text(ONE + "#" + "\N{GRINNING FACE}" * (LARGEST_TEXT - len(ONE) - 1), encoding="utf-8")
    assert read_faults(path) == parse_faults(ONE)


# Hints


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("JOINT2.TACHOMETER", "joint2.tachometer"),
        ("joint2.tacho", "joint2.tachometer"),
        ("node.18", "node.0x12"),
        ("node.0X12", "node.0x12"),
        ("NODE.12", "node.0x12"),
        ("joint2.lach", "joint2.latch"),
    ],
)
def test_a_hint_is_the_word_that_was_meant(word: str, meant: str) -> None:
    known = ("joint2.latch", "joint2.tachometer", "joint3.tachometer", "node.0x12", "node.0x7f")
    assert nearest(word, known, "the list") == f"; did you mean {meant!r}? See the list"


def test_a_hint_at_nothing_near_names_all() -> None:
    assert nearest("x", ("tap", "fault"), "the list") == "; known are tap, fault; see the list"
    assert nearest("x", ("tap", "fault")) == "; known are tap, fault"


# What is refused


@pytest.mark.parametrize("text", ["", "# nothing\n", "parallel = false", "set = []"])
def test_a_text_without_a_set_is_refused_and_clears_nothing(text: str) -> None:
    assert refusal(text) == 'f.toml: holds no set; to clear all, write clear = ""'


def test_an_empty_name_clears_nothing() -> None:
    """`canarm fault clear "$NAME"`, and nobody has set it."""
    with pytest.raises(FaultError, match="the name of the set is empty; leave it out to clear all sets"):
        clearing("")


def test_text_that_is_not_toml_is_refused_in_one_line() -> None:
    assert refusal("[[set]\n").startswith("f.toml: not valid TOML: ")
    assert refusal("a = " + "[" * 10_000) == "f.toml: brackets are nested too deep"


@pytest.mark.parametrize("text", ["{}.a = 1", "[{}]", "[[{}]]", 'v = [ """"""", {{{} = 1}}]', "a.{} = 1 # {}"])
def test_a_key_of_absurdly_many_parts_is_refused_before_it_is_parsed(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parsing takes a time that grows with the square of the parts: seconds for 30,000."""
    monkeypatch.setattr("tomllib.loads", lambda text: pytest.fail("parsed"))
    for part in ("a", "'a.b'", '"a = b"'):
        many = " . ".join([part] * 5000)
        assert "parts between dots; must have at most 32" in refusal(text.replace("{}", many, 1).replace("{}", ""))


def test_dots_that_make_no_key_longer_are_no_reason_to_refuse() -> None:
    dots = "." * 200
    texts = [f'"{dots}\\"{dots}"', f"'{dots}'", f'"""\n{dots}\n"" {dots}"""', f"'''{dots}'''", f'"" # " {dots}']
    for text in texts:
        assert isinstance(only_set(f'[[set.fault]]\ntap = "t"\nfault = "f"\nv = {text}').faults[0].parameters["v"], str)
    assert "v = [0.5, 0.5" in refusal_of_set(f'[[set.fault]]\ntap = "t"\nfault = "f"\nv = [{"0.5, " * 100}]')
    assert "unknown key 'a'" in refusal(".".join(["a"] * 32) + " = 1")


@pytest.mark.parametrize("number", ["1" * 5000, "0x" + "f" * 5000])
def test_a_whole_number_without_end_is_refused_in_our_words(number: str) -> None:
    assert refusal_of_set(f"at = {number}") == "f.toml: a whole number is too long; must have at most 600 digits"


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
        ("clear = true", 'f.toml: clear = True: must be the name of a set, or "" for all sets'),
        ("clear = false", 'f.toml: clear = False: must be the name of a set, or "" for all sets'),
        ("clear = 3", 'f.toml: clear = 3: must be the name of a set, or "" for all sets'),
        ("parallel = true", 'f.toml: holds no set; to clear all, write clear = ""'),
        ('clear = "a"\ntrigger = "b"', "f.toml: 'clear' and 'trigger' stand alone"),
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
        ("name = 3", "name = 3: must be one line of 1 to 80 printable characters"),
        ('name = ""', "name = '': must be one line of 1 to 80 printable characters"),
        ('name = "a\\nb"', "name = 'a\\nb': must be one line of 1 to 80 printable characters"),
        (f'name = "{"a" * 81}"', f"name = '{'a' * 81}': must be one line of 1 to 80 printable characters"),
        ("at = 1\ncycle = 3", "has at and cycle; must have one trigger: at, cycle, when, manual"),
        ("at = -0.1", "at = -0.1: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = 1e7", "at = 10000000.0: must be a number of seconds, at least 0, at most 1e+06"),
        (f"at = 1{'0' * 400}", f"at = 1{'0' * 99}…{'0' * 100}: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = nan", "at = nan: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = inf", "at = inf: must be a number of seconds, at least 0, at most 1e+06"),
        ("at = true", "at = True: must be a number of seconds, at least 0, at most 1e+06"),
        ('at = "1"', "at = '1': must be a number of seconds, at least 0, at most 1e+06"),
        ("duration = 0", "duration = 0: must be a number of seconds, greater than 0, at most 1e+06"),
        (
            "repeat = 2\nduration = 1\nperiod = -1",
            "period = -1: must be a number of seconds, greater than 0, at most 1e+06",
        ),
        ("cycle = -1", "cycle = -1: must be a whole number, at least 0, at most 2147483647"),
        ("cycle = 1.5", "cycle = 1.5: must be a whole number, at least 0, at most 2147483647"),
        ("cycle = true", "cycle = True: must be a whole number, at least 0, at most 2147483647"),
        ("cycle = 2147483648", "cycle = 2147483648: must be a whole number, at least 0, at most 2147483647"),
        ("repeat = 0\nduration = 1", "repeat = 0: must be a whole number, at least 1, at most 2147483647"),
        ("when = 3", 'when = 3: must be text, such as "joint2.angle_deg > 30"'),
        ("manual = 1", "manual = 1: must be true or false"),
        ("repeat = 2", "repeat = 2: needs a duration, after which the faults end and come again"),
        (
            "repeat = 2\nduration = 0.5\nperiod = 0.5",
            "period = 0.5: must be longer than the duration, 0.5 s",
        ),
        ("duration = 0.1\nperiod = 0.5", "period = 0.5: needs repeat, 2 or more: how often the faults come in all"),
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
