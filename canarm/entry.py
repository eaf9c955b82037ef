"""The program `canarm`, before anything else is imported: Ctrl-C then ends it as it does later, with a line.

Nothing belongs here that takes time to import.
"""

import sys

FAILED = 1


def main() -> None:
    """Import the command line and run it. Ctrl-C before a command has begun is status 1."""
    try:
        from .cli import main as run_command_line

        run_command_line()
    except KeyboardInterrupt:
        print("canarm: interrupted", file=sys.stderr)
        sys.exit(FAILED)
