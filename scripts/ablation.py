"""Write docs/ablation.md and its pictures: what each term of the control laws is worth. Takes some minutes.

The same versions on the same machine give the same bytes.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from ablation_page import misfits, page, pictures
from ablation_runs import Results, run_all

DOCS = Path(__file__).parent.parent / "docs"


def write(results: Results, docs: Path) -> None:
    """Page and pictures into the folder `docs`."""
    (docs / "pictures").mkdir(parents=True, exist_ok=True)
    (docs / "ablation.md").write_text(page(results), encoding="utf-8")
    for name, text in pictures(results).items():
        (docs / "pictures" / name).write_text(text, encoding="utf-8")


def main() -> int:
    """Run the grid and write the page. Exit status 1 if a finding no longer holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: %(default)s)")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of the page (default: docs/)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if arguments.jobs > 1:
            with ProcessPoolExecutor(arguments.jobs) as executor:
                results = run_all(Path(folder), executor)
        else:
            results = run_all(Path(folder))
    write(results, arguments.docs)
    failed = misfits(results)
    for finding in failed:
        print(f"scripts/ablation_findings.py: does not hold any more: {finding.text}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
