"""Decision records: numbered without gap or repetition, each as its title says."""

import re
from pathlib import Path

RECORDS = sorted((Path(__file__).parents[2] / "docs" / "decisions").glob("*.md"))


def test_every_number_stands_once() -> None:
    assert [int(record.name[:4]) for record in RECORDS] == list(range(1, len(RECORDS) + 1))


def test_titles_have_the_numbers_of_their_files() -> None:
    for record in RECORDS:
        title = record.read_text(encoding="utf-8").partition("\n")[0]
        found = re.match(r"# (\d+)\. ", title)
        assert found is not None, f"{record.name}: {title}"
        assert int(found[1]) == int(record.name[:4])
