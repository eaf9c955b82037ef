"""Settings that hold for every test: Hypothesis without deadlines, the same examples in CI, compiled modules kept."""

import contextlib
import os
import signal
import sys

from hypothesis import settings

# A shell that starts the tests in the background has SIGINT ignored, nohup SIGHUP; every process that they start would
# inherit it.
for ignored, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        with contextlib.suppress(ValueError):  # not in the main thread
            signal.signal(ignored, handler)

# The tests start hundreds of processes. With this set, each would compile all that it imports: twice the time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("canarm", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("canarm")
