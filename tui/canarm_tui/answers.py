"""What was answered to the user's last key, for as long as it stands below the header. Time is passed in.

What is asked, and of whom, is not known here.
"""

from collections.abc import Callable

from .fault_desk import Refusal
from .fault_texts import answer_word
from .steady import SteadyApp
from .texts import Tone, Word

ANSWER_NS = 6_000_000_000
"""How long an answer stays."""
Holds = Callable[[], bool]


class Answers:
    """The last answer; it goes earlier as soon as what it says holds no more."""

    def __init__(self) -> None:
        self._word: Word | None = None
        self._until_ns = 0
        self._holds: Holds | None = None

    def tell(self, answer: str | Refusal | Word, now_ns: int, holds: Holds | None = None) -> None:
        """Show an answer of the bench, or of ours, for a while, and only while it `holds`."""
        self._word = answer if isinstance(answer, Word) else answer_word(answer)
        self._until_ns, self._holds = now_ns + ANSWER_NS, holds

    def at(self, now_ns: int) -> Word | None:
        """What stands at the wall time `now_ns`."""
        if self._word is not None and (now_ns >= self._until_ns or not (self._holds is None or self._holds())):
            self._word = None
        return self._word

    def notice(self, link: Word | None, now_ns: int) -> Word | None:
        """What stands where there is room for one: what failed, before what is said of the `link`, before the rest."""
        said = self.at(now_ns)
        return said if link is None or (said is not None and said.tone is Tone.BAD) else link


class AnsweringApp(SteadyApp):
    """An application that shows answers. `clock_ns` is the wall clock in ns."""

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        super().__init__()
        self._clock_ns, self._said = clock_ns, Answers()

    @property
    def answer(self) -> Word | None:
        """What was answered to the last key, while that stands."""
        return self._said.at(self._clock_ns())

    def tell(self, answer: str | Refusal | Word | None, holds: Holds | None = None) -> None:
        """Show an answer of the bench, or of ours, for a while, and only while it `holds`."""
        if answer is not None:
            self._said.tell(answer, self._clock_ns(), holds)
