"""Paths as people write them: a shell leaves the `~` of `--out=~/x` as it is, and Python's calls see no shell."""

from __future__ import annotations

import os
from pathlib import Path

# What may stand before the file of a planner's specification: an executable of its own.
_BEFORE = ("exe:",)


def expanded(path: str | Path) -> Path:
    """The path with `~` and `~name` at its beginning as the home folder; as it is for a name that nobody has."""
    return Path(os.path.expanduser(path))  # noqa: PTH111  (Path.expanduser raises for a name that nobody has)


def expanded_text(text: str) -> str:
    """The same of words that may begin with a path, such as `~/mine.py:Planner` and `exe:~/mine`."""
    before = next((prefix for prefix in _BEFORE if text.startswith(prefix)), "")
    return before + os.path.expanduser(text.removeprefix(before))  # noqa: PTH111
