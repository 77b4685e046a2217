"""Property tests draw the same examples each time, so that a red test is a change's own; soak with
HYPOTHESIS_PROFILE=soak, which draws anew and much more."""

import os

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=2000, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))
