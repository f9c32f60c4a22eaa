"""A control group of the kernel's for a sandbox: a limit for all its processes together, where groups can be made."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

_MOUNTED: Final = Path("/sys/fs/cgroup")
_MEMBERSHIP: Final = Path("/proc/self/cgroup")
_PREFIX: Final = "tsbench-sandbox-"
_PATIENCE_S, _STEP_S = 1.0, 0.01
_counter = itertools.count()


class ControlGroup:
    """members: files to which a process writes its number to be in the group, with all that it starts then."""

    def __init__(self, memory_bytes: int, processes: int) -> None:
        """memory_bytes, processes: the most that those in it have together; without swap.

        Raises OSError where groups cannot be made here, or not by this user.
        """
        name = f"{_PREFIX}{os.getpid()}-{next(_counter)}"
        self._folders: list[Path] = []
        try:
            for parent, limits in _hierarchies(memory_bytes, processes):
                _remove_abandoned(parent)
                folder = parent / name
                folder.mkdir()
                self._folders.append(folder)
                for file, value in limits.items():
                    # Where the kernel counts no swap there is no such file.
                    if "sw" not in file or (folder / file).exists():
                        (folder / file).write_text(str(value))
        except OSError:
            self.remove()
            raise
        self.members = [folder / "cgroup.procs" for folder in self._folders]

    def remove(self) -> None:
        """Remove it, once those in it have ended; what does not end within a second is left for the next that looks."""
        end = time.monotonic() + _PATIENCE_S
        for folder in self._folders:
            while folder.exists():
                with suppress(OSError):
                    folder.rmdir()
                    break
                if time.monotonic() > end:
                    return
                time.sleep(_STEP_S)


def _hierarchies(memory_bytes: int, processes: int) -> list[tuple[Path, Mapping[str, int]]]:
    """Folders to make a group in, and its limits by the names of files: one of version 2, or two of version 1.

    Raises OSError where there are none.
    """
    lines = (line.split(":", 2) for line in _MEMBERSHIP.read_text(encoding="utf-8").splitlines())
    own = {kind: place.strip("/") for _, kinds, place in lines for kind in kinds.split(",")}
    if "" in own:
        here = _MOUNTED / own[""]
        # A group with processes in it has none below, so it is one above whose limits can be divided.
        for folder in (here, *here.parents):
            if not folder.is_relative_to(_MOUNTED):
                break
            with suppress(FileNotFoundError):
                if {"memory", "pids"} <= set((folder / "cgroup.subtree_control").read_text().split()):
                    return [(folder, {"memory.max": memory_bytes, "memory.swap.max": 0, "pids.max": processes})]
    if {"memory", "pids"} <= own.keys():
        memory = {
            "memory.limit_in_bytes": memory_bytes,
            "memory.memsw.limit_in_bytes": memory_bytes,
            "memory.swappiness": 0,
        }
        return [
            (_MOUNTED / "memory" / own["memory"], memory),
            (_MOUNTED / "pids" / own["pids"], {"pids.max": processes}),
        ]
    raise FileNotFoundError(0, "no control groups of memory and processes", str(_MOUNTED))


def _remove_abandoned(parent: Path) -> None:
    """Remove the groups of workers that were killed; one with processes in it stays."""
    for folder in sorted(parent.glob(f"{_PREFIX}*")):
        owner = folder.name.removeprefix(_PREFIX).split("-")[0]
        if not Path("/proc", owner).exists():
            with suppress(OSError):
                folder.rmdir()
