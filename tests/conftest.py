"""What holds for all tests: property tests draw the same examples everywhere, a busy machine is no failure, and a
process of the suite stays small.
"""

from hypothesis import settings

pytest_plugins = ["memory_guard", "own_process"]

settings.register_profile("tsbench", deadline=None, derandomize=True)
settings.load_profile("tsbench")
