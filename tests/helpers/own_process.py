"""`@pytest.mark.own_process`: the test runs in a process of its own, which takes its memory along when it ends.

For trainings: an optimiser alone brings 0.1 GB of modules that nothing else needs. A plugin of `tests/conftest.py`.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

_THERE = "TSBENCH_TEST_IN_OWN_PROCESS"


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Called by pytest: the test as pytest runs it alone. Its fixtures are made there once more."""
    if pyfuncitem.get_closest_marker("own_process") is None or _THERE in os.environ:
        return None
    # No worker's, whose memory is watched (memory_guard.py).
    outside = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_XDIST")} | {_THERE: "1"}
    pytest_alone = [sys.executable, "-m", "pytest", "-p", "no:xdist", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*pytest_alone, pyfuncitem.nodeid], cwd=pyfuncitem.config.rootpath, env=outside,
        text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )  # fmt: skip
    if done.returncode:
        pytest.fail(f"in a process of its own (exit code {done.returncode}):\n{done.stdout}", pytrace=False)
    return True
