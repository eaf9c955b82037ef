"""Texts of others reach no terminal raw: names in cells, headers of files, what a bench answers."""

from pathlib import Path

import pytest

from canarm_protocol.cell.cell_file import load_cell
from canarm_protocol.errors import CellError, FaultError
from canarm_protocol.shown import (
    LONGEST_LINE,
    LONGEST_OF_LINES,
    MOST_LINES,
    printable,
    printable_lines,
    printable_values,
)

RED = "\x1b[31m"


def test_escape_sequences_are_shown_and_not_obeyed() -> None:
    assert printable(f"{RED}red\r\u202e") == "\\x1b[31mred\\r\\u202e"
    assert printable_lines("one\ntwo\x07") == "one\ntwo\\x07"
    assert printable_values({f"a{RED}": ["b\n", 1, None]}) == {"a\\x1b[31m": ["b\\n", 1, None]}


def test_endless_texts_are_cut() -> None:
    assert len(printable("x" * 10**6)) < LONGEST_LINE + 10
    assert printable_lines("x\n" * 10**5).count("\n") == MOST_LINES


def test_no_word_of_a_message_is_longer_than_a_text_that_is_shown_and_no_message_endless() -> None:
    said = str(FaultError(f"set {'x' * 10**6} of {'a b ' * 10**5} is wrong"))
    assert max(map(len, said.split())) == LONGEST_LINE + 1
    assert said.startswith("set xxx")
    assert said.endswith("a b  is wrong")
    assert len(said) == LONGEST_OF_LINES + 1


def test_an_error_that_repeats_a_strangers_text_is_fit_for_a_terminal() -> None:
    assert str(FaultError(f"set '{RED}': no such tap")) == "set '\\x1b[31m': no such tap"


def test_a_cell_whose_title_is_no_line_of_text_is_refused(tmp_path: Path) -> None:
    text = Path(load_cell.__code__.co_filename).parents[1].joinpath("cells/konkuk1.toml").read_text()
    path = tmp_path / "cell.toml"
    path.write_text(text.replace('title = "KON-KUK I', 'title = "\\u001b[31mKON-KUK I'))
    with pytest.raises(CellError, match="title"):
        load_cell(str(path))
