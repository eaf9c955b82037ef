"""Write docs/papers.md: what the first paper shows and this bench can repeat. Takes half a minute.

The same versions on the same machine give the same bytes. Exit status 1 if a sentence no longer holds.
"""

import argparse
import sys
from pathlib import Path

from paper_page import Results, claims, page
from paper_runs import cases, fastest, outcome

from canarm.workers.pool import results_of

DOCS = Path(__file__).parent.parent / "docs"


def compute(jobs: int = 1) -> Results:
    """Run everything, with `jobs` processes."""
    runs = cases()
    found = dict(results_of(outcome, runs, jobs))
    return Results({case: found[place] for place, case in enumerate(runs)}, *fastest())


def main() -> int:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of the page (default: docs/)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    arguments = parser.parse_args()
    results = compute(arguments.jobs)
    (arguments.docs / "papers.md").write_text(page(results), encoding="utf-8")
    failed = [claim for claim in claims(results) if not claim.holds]
    for claim in failed:
        print(f"scripts/paper_page.py: does not hold any more: {claim.printed}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
