"""What holds for all tests: property tests draw the same examples everywhere, and a busy machine is no failure."""

from hypothesis import settings

settings.register_profile("tsbench", deadline=None, derandomize=True)
settings.load_profile("tsbench")
