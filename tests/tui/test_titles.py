"""Titles are of whole words and numbers at any width: what does not fit is left out."""

import itertools

import pytest

from canarm_tui.styles import title_of
from canarm_tui.texts import Word

TITLES = (
    ["joint2 error +0.15 LSB", "✓ within ±1 LSB", "rms 0.46", "max 0.83"],
    ["side view x–y", "tip +0.277 +0.209 m", "━ true ┄ reference"],
    ["joint2 current A", "━ motor −0.641", "┄ cmd −0.675", "┃ 0.012 s"],
)


@pytest.mark.parametrize("title", TITLES, ids=lambda title: title[0])
def test_a_title_is_never_cut_within_a_word_or_a_number(title):
    possible = {sep.join(title[:count]) for sep in (" │ ", " ") for count in range(1, len(title) + 1)}
    for width in range(len(title[0]), 100):
        shown = title_of([Word(text) for text in title], width).plain
        assert shown in possible
        assert len(shown) <= width


@pytest.mark.parametrize("title", TITLES, ids=lambda title: title[0])
def test_a_title_has_as_many_words_as_fit(title):
    counts = [
        sum(text in title_of([Word(each) for each in title], width).plain for text in title) for width in range(100)
    ]
    assert all(few <= more for few, more in itertools.pairwise(counts))
    assert counts[-1] == len(title)
    room = len(" ".join(title[:2]))
    assert (counts[room - 1], counts[room]) == (1, 2)
