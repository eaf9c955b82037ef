"""Settings that hold for every test: Hypothesis without deadlines, and the same examples every time in CI."""

import os

from hypothesis import settings

settings.register_profile("canarm", deadline=None, derandomize="CI" in os.environ, print_blob=True)
settings.load_profile("canarm")
