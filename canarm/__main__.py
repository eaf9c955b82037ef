"""`python -m canarm`."""

from .cli import main

main()
