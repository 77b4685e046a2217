"""Property tests draw the same examples each time, so that a red test is a change's own, and have
no deadline, as a first call compiles. HYPOTHESIS_PROFILE=soak draws anew, and more of them where a
test does not say how many."""

import os

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.register_profile("soak", max_examples=2000, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))
