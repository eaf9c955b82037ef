"""`python -m canarm`."""

from .entry import main

main()
