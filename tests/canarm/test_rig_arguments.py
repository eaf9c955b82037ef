"""What a rig takes from Python: classes, functions, arrays, files beside a law; and what it warns of."""

import gc
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import canarm
from canarm import Rig
from canarm.rig.arguments import RigWarning
from canarm_controller.errors import TrajectoryError
from canarm_controller.laws.base import Cycle
from canarm_controller.laws.pd import Pd
from canarm_controller.run.controller import State
from canarm_protocol.errors import CanarmError

CYCLE_S = 0.0025


class Softer(Pd):
    """A law that has no file of its own."""

    name = "softer"


def nothing(cycle: Cycle) -> Sequence[float]:
    """A law that is a function."""
    return [0.0] * len(cycle.position_rad)


def test_a_law_may_be_a_class_or_a_function() -> None:
    with Rig(law=Softer) as rig, Rig(law="pd") as named:
        rig.run(0.5)
        named.run(0.5)
        assert rig.joints["joint2"].true_angle_rad.tolist() == named.joints["joint2"].true_angle_rad.tolist()
        assert rig.summary().law == "Softer"
    with Rig(law=nothing) as rig:
        rig.run(0.05)
        assert not rig.joints["joint2"].command_a.any()


def test_a_law_may_be_a_path_and_its_only_class_need_not_be_named(tmp_path: Path) -> None:
    path = tmp_path / "law.py"
    path.write_text("from canarm_controller.laws.pd import Pd\n\nclass Mine(Pd):\n    name = 'mine'\n")
    with Rig(law=path) as rig:
        rig.run(0.05)
        assert rig.state is State.RUNNING


def test_a_law_file_imports_what_lies_beside_it_and_each_folder_its_own(tmp_path: Path) -> None:
    for folder, gain in (("one", 1.0), ("two", 2.0)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "gains_of_mine.py").write_text(f"GAIN = {gain}\n")
        (tmp_path / folder / "law.py").write_text(
            "from gains_of_mine import GAIN\nfrom canarm_controller.laws.pd import Pd\n\n"
            "class Mine(Pd):\n    name = f'gain {GAIN}'\n"
        )
    for folder, gain in (("one", 1.0), ("two", 2.0), ("one", 1.0)):
        rig = Rig(law=f"{tmp_path / folder / 'law.py'}:Mine")
        assert rig.controller.loop.law.name == f"gain {gain}"
    assert [folder for folder in sys.path if folder.startswith(str(tmp_path))] == [str(tmp_path / "one")]


def sine(time_s: float) -> tuple[float, float]:
    """Angles in rad."""
    return 0.35 + 0.3 * np.sin(2.0 * time_s), 0.2 * np.sin(3.0 * time_s)


@pytest.mark.parametrize("kind", ["array", "columns", "function"])
def test_a_trajectory_may_be_an_array_a_table_or_a_function(kind: str) -> None:
    times = np.arange(0.0, 2.0, CYCLE_S)
    angles = np.array([sine(time) for time in times])
    columns = {"time_s": times, "joint2_rad": angles[:, 0], "joint3_rad": angles[:, 1]}
    with Rig(trajectory={"array": angles, "columns": columns, "function": sine}[kind]) as rig:
        rig.run(2.5)
        assert rig.reason is None
        first = round(rig.approach_s / CYCLE_S)
        np.testing.assert_allclose(rig.joints["joint2"].reference_rad[first : first + 400], angles[:400, 0], atol=1e-9)
        assert np.abs(rig.joints["joint2"].error_lsb[first + 200 : first + 400]).max() < 3.0


CHANGING = """
from canarm_controller.laws.pd import Pd


class Changing(Pd):
    name = "changing"
    calls = 0

    def internals(self):
        self.calls += 1
        return {"first" if self.calls < 100 else "second": [0.0, 0.0]}
"""


def test_a_law_whose_internals_change_ends_alike_recorded_or_not(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(CHANGING)
    ends = []
    for out in (None, tmp_path / "run"):
        with Rig(law=f"{tmp_path / 'law.py'}:Changing", out=out) as rig:
            rig.run(1.0)
            assert rig.reason is not None
            assert rig.reason.startswith("law-failed: law Changing: internals() must give 2 numbers")
            ends.append(rig.detections[0].tick)
    assert ends == [98, 98]  # the first call is at the start


def test_internals_are_timed_as_the_laws_own() -> None:
    now_ns = [0]

    class Pondering(Pd):
        def internals(self) -> dict[str, list[float]]:
            now_ns[0] += 3_000_000_000
            return {"thought": [0.0, 0.0]}

    with Rig(law=Pondering) as rig:
        rig.controller.loop.stopwatch = lambda: now_ns[0]
        rig.run(0.01)
        assert rig.controller.loop.law_ns == 3_000_000_000


@pytest.mark.parametrize("given", [{"thought": 0.0}, {"thought": ["x", "y"]}, [0.0], {"thought": [0.0]}])
def test_internals_of_another_form_are_told_what_to_be(given: Any) -> None:
    class Odd(Pd):
        calls = 0

        def internals(self) -> Any:
            self.calls += 1
            return {"thought": [0.0, 0.0]} if self.calls < 3 else given

    with Rig(law=Odd) as rig:
        rig.run(0.1)
        assert rig.reason is not None
        assert "internals() must give 2 numbers, one per joint, for each of the names" in rig.reason


@pytest.mark.parametrize("value", [True, 1, "1", "true", "True", np.True_])
def test_a_switch_of_the_truth_may_be_written_in_any_way(value: object) -> None:
    rig = Rig(truth={"joint2.wire": value})
    assert rig._bench.world.truth.joints[0].has_elastic_wire


def test_a_rig_that_has_never_run_warns() -> None:
    with pytest.warns(RigWarning, match="has never run: it has tested nothing") as caught, Rig():
        pass
    assert caught[0].filename == __file__


def test_a_rig_that_is_neither_run_nor_finished_warns_where_it_was_made() -> None:
    rig = Rig()
    rig.inject("joint2.tachometer", "stuck", at=1.0)
    del rig
    with pytest.warns(RigWarning, match=r"nobody has run this rig: it has tested nothing \(rig\.run\?\)") as caught:
        gc.collect()
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = Rig()
        run.run(0.1)
        del run
        gc.collect()


def test_a_finding_that_nobody_asks_warns_where_the_assert_is_missing() -> None:
    with Rig() as rig:
        rig.run(0.1)
        with pytest.warns(RigWarning, match=r"assert\?\): joint2\.current_a is .* must stay below 0") as caught:
            rig.joints["joint2"].stays_below("current_a", 0.0)
        assert caught[0].filename == __file__
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert rig.joints["joint2"].stays_below("current_a", 9.0)
            assert not rig.joints["joint2"].stays_below("current_a", 0.0).holds


def test_a_question_about_a_detection_that_nobody_looks_at_warns() -> None:
    with Rig() as rig:
        rig.run(0.01)
        match = r"nobody has asked whether current-mismatch at joint2 was not detected \(assert\?\)"
        with pytest.warns(RigWarning, match=match):
            rig.detected("current-mismatch", "joint2")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert not rig.detected()
            assert rig.detected().latency_s is None
            assert list(rig.detected().found) == []


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"faults": 5}, "faults: 5: must be a fault file, its text as TOML, or a script"),
        ({"faults": ["a.toml"]}, "faults: ['a.toml']: must be a fault file, its text as TOML, or a script"),
        ({"out": 5}, "out 5: must be the path of a folder"),
        ({"out": "a\0b"}, "out 'a\\x00b': must be the path of a folder"),
        ({"history_s": 1e300}, "history_s 1e+300: 4e+302 cycles do not fit into memory; take less"),
        ({"history_s": 1e12}, "history_s 1e+12: 4e+14 cycles do not fit into memory; take less"),
        ({"wire": "no"}, "wire 'no': must be True or False"),
        ({"truth": {"joint3.mas": 1}}, "truth joint3.mas=1: no such key; did you mean 'joint3.mass'?"),
        ({"truth": {"joint3.mass": "heavy"}}, "truth joint3.mass=heavy: must be a number from 0.001 to 1000 kg"),
        ({"settings": {"control.damp": 1}}, "settings control.damp=1: no such key"),
        (
            {"settings": {"control.damping_ratio": -1}},
            "konkuk1 with settings: control.damping_ratio = -1: must be",
        ),
        ({"law": "slotine-li", "feedforward": "table"}, "its feed-forward must be none, not table"),
        ({"history_s": -1.0}, "history_s -1: must be at least one cycle"),
    ],
)
def test_an_error_names_the_argument_that_is_wrong_and_no_word_of_the_command_line(
    given: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(CanarmError) as raised:
        Rig("konkuk1", **given)
    assert complaint in str(raised.value)
    assert not {"--truth", "--set", "--seconds", "--feedforward"} & set(str(raised.value).split())


@pytest.mark.parametrize(
    ("angles", "complaint"),
    [
        (np.zeros((2, 100)), "an array of shape (2, 100); must be (n, 2) with n of at least 3: angles in rad, one row"),
        (np.zeros((2, 100)), "one column per joint; give its transpose, .T"),
        (np.zeros(5), "an array of shape (5,); must be (n, 2)"),
        (np.full((100, 2), 30.0), "the array's angles are rad: are these degrees? Then np.radians(...)"),
        (np.array([[0.0, 0.0], [0.0, np.nan], [0.0, 0.0]]), "row 1, joint3: nan; must be a finite number, in rad"),
    ],
)
def test_an_array_that_is_no_motion_is_answered_with_the_shape_and_unit_that_would_be(
    angles: np.ndarray, complaint: str
) -> None:
    with pytest.raises(TrajectoryError) as raised:
        Rig("konkuk1", trajectory=angles)
    assert complaint in str(raised.value)


def test_the_package_says_what_it_has_and_which_version_it_is() -> None:
    names = [name for name in dir(canarm) if not name.startswith("__")]
    assert names == ["BenchClient", "BusRig", "Rig", "Run", "State", "open_run"]
    assert {"__all__", "__doc__", "__version__"} <= set(dir(canarm))
    assert canarm.__version__.count(".") == 2


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda rig: Rig("konkuk1", truth="joint3.mass=0.9"), "must be a mapping of keys and values"),
        (lambda rig: Rig("konkuk1", truth=["joint3.mass=0.9"]), "must be a mapping of keys and values"),
        (lambda rig: rig.change_truth(3, 1), "3: a key is a name"),
        (lambda rig: rig.run(seconds="2"), "seconds '2': must be a number"),
        (lambda rig: rig.run(seconds=True), "seconds True: must be a number"),
        (lambda rig: rig.joints["joint2"].stays_below("current_a", "1"), "limit '1': must be a number"),
        (lambda rig: rig.joints["joint2"].stays_below("current_a", np.nan), "limit nan: must be a number"),
        (lambda rig: rig.joints["joint2"].stays_below("current_a", 1.5, since=np.nan), "since nan: must be a number"),
    ],
)
def test_an_argument_of_another_type_is_answered_in_words(ask: Any, message: str) -> None:
    """NaN above all: whatever is compared with it is false, so that `assert not …` would pass."""
    with Rig(law="pd") as rig:
        rig.run(0.01)
        with pytest.raises(CanarmError, match=message):
            ask(rig)
