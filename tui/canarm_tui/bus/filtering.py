"""What a reader wants to see of a bus, typed as words: identifiers, ranges, names, sorts, each also excluded."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from canarm_protocol.canopen.frames import Frame
from canarm_protocol.decoding import Meaning

MOST_TERMS, LONGEST = 16, 120
_IDENTIFIER = re.compile(r"(?:0x)?([0-9a-f]{1,8})(?:-(?:0x)?([0-9a-f]{1,8}))?", re.ASCII)
HOW = "words that all must fit: 294 or 200-2ff (identifiers), adc, sdo, tpdo2; -sync leaves out"


@dataclass(frozen=True, slots=True)
class _Term:
    text: str
    span: tuple[int, int] | None
    is_excluded: bool


@dataclass(frozen=True, slots=True)
class FrameFilter:
    """The words of a filter; without any, all frames fit."""

    terms: Sequence[_Term] = ()

    @classmethod
    def parse(cls, text: str) -> "FrameFilter":
        """Every text is a filter. A word that is a hexadecimal number is an identifier, also where it is a name."""
        terms = []
        for word in text[:LONGEST].casefold().split()[:MOST_TERMS]:
            is_excluded = word.startswith("-") and len(word) > 1
            word = word[1:] if is_excluded else word
            found = _IDENTIFIER.fullmatch(word)
            span = None if found is None else (int(found[1], 16), int(found[2] or found[1], 16))
            terms.append(_Term(word, span, is_excluded))
        return cls(terms)

    def fits(self, frame: Frame, meaning: Meaning) -> bool:
        """Whether `frame`, which means `meaning`, is wanted."""
        return all(_fits(term, frame, meaning) is not term.is_excluded for term in self.terms)


def _fits(term: _Term, frame: Frame, meaning: Meaning) -> bool:
    if term.span is not None and term.span[0] <= frame.can_id <= term.span[1]:
        return True
    return term.text in f"{meaning.sort.value} {meaning.title} {'wrong' if meaning.is_wrong else ''}".casefold()
