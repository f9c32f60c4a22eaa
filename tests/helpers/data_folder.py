"""A data folder of a test's own, in the clone's place."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tsbench.core.paths import data_root


@contextmanager
def in_force(root: Path) -> Iterator[pytest.MonkeyPatch]:
    """All data come from this folder meanwhile. What else is patched with what is given is undone at the end, too."""
    with ExitStack() as ending:
        ending.callback(data_root.cache_clear)
        patch = ending.enter_context(pytest.MonkeyPatch.context())
        patch.setenv("TSBENCH_DATA", str(root))
        data_root.cache_clear()
        yield patch
