"""The dashboard as a program of its own, for the test in a real terminal: dashboard_program.py PORT."""

import sys

from canarm_protocol.cell.cell_file import load_cell
from canarm_tui import run_dashboard

if __name__ == "__main__":
    sys.exit(run_dashboard(load_cell("konkuk1"), "canarm", "bench", {"port": int(sys.argv[1])}))
