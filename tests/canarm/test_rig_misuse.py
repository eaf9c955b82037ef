"""What a rig is asked in the wrong way is answered with the argument, its value, and what would be right."""

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from canarm import BenchClient, Rig, open_run
from canarm_controller.errors import TrajectoryError
from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import CanarmError, UsageError
from canarm_protocol.faults.bench_client import BenchClient as Client

HUGE, ENDLESS = 10**400, 10**5000
"""Beyond what a float can hold, and beyond what Python writes out (`sys.get_int_max_str_digits`)."""


class Mute:
    """Its own code fails when it is shown."""

    def __repr__(self) -> str:
        raise RuntimeError


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    """A rig that has run for 10 cycles."""
    with Rig(law="pd") as rig:
        rig.run(0.025)
        yield rig


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda rig: rig.detected(5), "detected: no detector 5; known are "),
        (lambda rig: rig.detected(["x"]), "detected: no detector ['x']; known are "),
        (
            lambda rig: rig.detected("tachometer-stuck", 5),
            "detected: no joint, card or node 5; known are joint2, joint3",
        ),
        (lambda rig: rig.detected("tachometer-stuck", "jiont2"), "did you mean 'joint2'? There are joint2, joint3"),
        (lambda rig: rig.detected(since="x"), "detected: since 'x': must be a number"),
        (lambda rig: rig.detected().within("x"), "within 'x': must be a number"),
        (lambda rig: rig.detected().within(None), "within None: must be a number"),
        (lambda rig: rig.detected().within(np.nan), "within nan: must be a number"),
        (lambda rig: rig.detected().within(-1), "within -1: must be 0 or more"),
        (lambda rig: rig.detected(since=0).within(1, of="x"), "within: of 'x': must be a number"),
        (lambda rig: rig.joints["joint2"].departure("current_a", "x", since=0), "by 'x': must be a number"),
        (lambda rig: rig.joints["joint2"].departure("current_a", -1, since=0), "by -1: must be 0 or more"),
        (lambda rig: rig.joints["joint2"].departure("current_a", 1, since="x"), "since 'x': must be a number"),
        (lambda rig: rig.joints["joint2"].stays_below("error_lsb", 3, since=HUGE), "is too large for a number"),
        (
            lambda rig: rig.joints["joint2"].stays_below("error_lsb", ENDLESS),
            "limit (a value of type int): is too large",
        ),
        (lambda rig: rig.joints["joint2"].stays_below("error_lsb", -3), "limit -3: must be 0 or more"),
        (lambda rig: rig.joints["joint2"].stays_within("current_a", 2, 1), "low 2: is above high, 1"),
        (lambda rig: rig.joints["joint2"].stays_within("current_a", 0, "1"), "high '1': must be a number"),
        (lambda rig: rig.joints["joint2"].span(5), "no history 5; known are true_angle_rad"),
        (lambda rig: rig.joints["joint2"].span(np.zeros(2)), "no history array([0., 0.]); known are true_angle_rad"),
        (lambda rig: rig.branch(None), "branch: None: must be a function, which is given the copy"),
        (lambda rig: rig.trigger(None), "trigger: None: must be the name of a set"),
        (lambda rig: rig.clear(5), "clear: 5: must be the name of a set; leave it out to clear all"),
        (lambda rig: rig.inject(Mute(), "stuck"), "inject: tap (a value of type Mute): must be a name"),
        (lambda rig: rig.change_truth("joint3.mass", Mute()), "(a value of type Mute): cannot be written as text"),
        (lambda rig: rig.run(HUGE), "is too large for a number"),
        (lambda rig: rig.to_dataframe(["pandas"]), "library ['pandas']: must be pandas or polars"),
        (lambda rig: rig.plot(5), "title 5: must be text"),
        (lambda rig: open_run(5), "open_run: 5: must be the path of a run folder"),  # type: ignore[arg-type]
        (lambda rig: open_run(".", "numpy"), "library 'numpy': must be pandas or polars"),
        (lambda rig: BenchClient(None, None), "BenchClient: port None: must be an open bus"),  # type: ignore[arg-type]
        (lambda rig: Rig(5), "cell 5: must be a name, a file or a Cell"),  # type: ignore[arg-type]
        (lambda rig: Rig(truth={5: 1}), "truth 5: a key is a name, such as 'joint3.mass'"),  # type: ignore[dict-item]
        (lambda rig: Rig(settings={5: 1}), "settings 5: a key is a name"),  # type: ignore[dict-item]
        (lambda rig: Rig(settings=5), "settings 5: must be a mapping of keys and values"),  # type: ignore[arg-type]
        (lambda rig: Rig(truth={"joint3.mass": ENDLESS}), "(a value of type int): cannot be written as text"),
        (lambda rig: Rig(seed=ENDLESS), "seed (a value of type int): must be at most 9223372036854775807"),
        (lambda rig: Rig(feedforward=np.zeros(2)), "must be none, table, online"),  # type: ignore[arg-type]
        (lambda rig: Rig(wire=np.zeros(2)), "wire array([0., 0.]): must be True or False"),  # type: ignore[arg-type]
    ],
)
def test_a_wrong_argument_is_named_with_its_value(rig: Rig, ask: Any, message: str) -> None:
    with pytest.raises(CanarmError) as raised:
        ask(rig)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    "given",
    [
        lambda t: {"joint2": 0.1, "joint3": 0.2},
        lambda t: ("a", "b"),
        lambda t: None,
        lambda t: 0.1,
        lambda t: (0.1, 0.2, 0.3),
        lambda t: (0.1, None),
        lambda t: (0.1, float("nan")),
        lambda t: [0.1] * (1 + (t > 1.0)),
    ],
)
def test_a_function_that_is_no_motion_is_told_what_to_return(given: Any) -> None:
    with pytest.raises(TrajectoryError) as raised:
        Rig("konkuk1", trajectory=given)
    wanted = "trajectory: the function must return 2 finite angles in rad for a time in s, in the order joint2, joint3"
    assert str(raised.value).startswith(f"{wanted}; it has returned ")


@pytest.mark.parametrize("given", [42, 1.5, True, np.float64(2.0), object()])
def test_what_is_no_motion_at_all_is_told_what_could_be(given: Any) -> None:
    with pytest.raises(TrajectoryError, match="must be a name, a file, a DataFrame, an array or a function"):
        Rig("konkuk1", trajectory=given)


def rest(time_s: float) -> tuple[float, float]:
    return 0.1, 0.2


POSES = np.tile([0.1, 0.2], (400, 1))
COLUMNS = {"time_s": [0.0, 1.0, 2.0], "joint2_deg": [1.0, 1.0, 1.0], "joint3_deg": [2.0, 2.0, 2.0]}


@pytest.mark.parametrize(
    ("trajectory", "named"),
    [
        (lambda t: (0.1, 0.2), "a function"),
        (rest, "rest"),
        (functools.partial(rest), "rest"),
        (POSES, "an array of 400 rows"),
        (POSES[:5].tolist(), "an array of 5 rows"),
        (COLUMNS, "a dict"),
        ("sine", "sine"),
    ],
)
def test_a_rig_says_what_its_motion_is(trajectory: Any, named: str) -> None:
    with Rig(trajectory=trajectory) as rig:
        rig.run(0.01)
        assert repr(rig) == f"<Rig konkuk1, mras on {named}, seed 0: running, 4 cycles kept>"
        assert rig.summary().trajectory == named


def test_a_rig_says_what_its_law_and_its_table_are() -> None:
    pandas = pytest.importorskip("pandas")
    with Rig(law=lambda cycle: (0.0, 0.0), trajectory=pandas.DataFrame(COLUMNS)) as rig:
        rig.run(0.01)
        assert repr(rig).startswith("<Rig konkuk1, a function on a DataFrame, ")


def test_the_known_names_are_listed_once(rig: Rig) -> None:
    with pytest.raises(UsageError) as raised:
        rig.joints["joint2"].stays_below("bogus", 1)
    assert str(raised.value).count("true_angle_rad") == 1


def test_a_misspelled_argument_of_a_rig_is_answered_with_the_right_one() -> None:
    with pytest.raises(TypeError, match=r"^Rig: no argument 'lw'; did you mean 'law'\?$") as raised:
        Rig("konkuk1", lw="mras")  # type: ignore[call-arg]
    assert isinstance(raised.value, UsageError)


def test_a_client_of_the_bench_is_told_what_is_no_cell() -> None:
    cell = load_cell("konkuk1")
    with pytest.raises(UsageError, match="BenchClient: port 'can0': must be an open bus"):
        Client("can0", cell)  # type: ignore[arg-type]


COMPLEX = {"time_s": [0.0, 1.0, 2.0], "joint2": [0.0] * 3, "joint3": [1j] * 3}


@pytest.mark.parametrize("given", [np.zeros((10, 2), complex), COMPLEX, lambda time_s: (0.0, 1j)])
def test_complex_angles_are_refused_in_words(given: Any) -> None:
    """Without a check numpy would drop the imaginary parts, with a warning."""
    with pytest.raises(TrajectoryError, match=r"^trajectory: complex numbers; angles and times are real$"):
        Rig(trajectory=given)


def test_an_absurd_angle_is_not_written_out() -> None:
    with pytest.raises(TrajectoryError, match=r"joint2 at sample 0 \(0 s\): 5\.73e\+301 deg is outside limits_deg"):
        Rig(trajectory=np.full((10, 2), 1e300))
