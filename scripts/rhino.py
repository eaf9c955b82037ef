"""Write docs/rhino.md and its pictures: the second paper's result, side by side. Takes some seconds.

The same versions on the same machine give the same bytes. Exit status 1 if a sentence no longer holds.
"""

import argparse
import sys
from pathlib import Path

from rhino_figures import compute
from rhino_page import misfits, page
from rhino_pictures import pictures

DOCS = Path(__file__).parent.parent / "docs"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of the page (default: docs/)")
    docs = parser.parse_args().docs
    results = compute()
    (docs / "pictures").mkdir(parents=True, exist_ok=True)
    (docs / "rhino.md").write_text(page(results), encoding="utf-8")
    for name, picture in pictures(results).items():
        (docs / "pictures" / name).write_text(picture, encoding="utf-8")
    failed = misfits(results)
    for finding in failed:
        print(f"scripts/rhino_findings.py: does not hold any more: {finding.text}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
