"""What the kernel holds a sandbox to: a filter of system calls (seccomp), and the limits of a control group."""

from __future__ import annotations

import errno
import itertools
import os
import platform
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from tsbench.core.errors import InputError

# Of a kind of machine: its number in seccomp's data, and the numbers of system calls. Refused are those on the kernel's
# keys, which outlive an episode, on namespaces and mounts, those that watch the kernel or reach into another process
# (bubblewrap's own has no filter), and those that take memory which no limit counts: System V's, and files that lie in
# no folder. /dev/shm stays, which is limited. System V's semaphores and queues leave numbers behind that go on. Devices
# and installed files are the machine's, so what sets times and what tells of the page cache or of accesses is refused.
_MACHINES: Final[Mapping[str, tuple[int, Mapping[str, int]]]] = {
    "x86_64": (0xC000003E, {
        "shmget": 29, "clone": 56, "ptrace": 101, "pivot_root": 155, "chroot": 161, "mount": 165, "umount2": 166,
        "add_key": 248, "request_key": 249, "keyctl": 250, "unshare": 272, "perf_event_open": 298, "setns": 308,
        "memfd_create": 319, "process_vm_readv": 310, "process_vm_writev": 311, "bpf": 321, "userfaultfd": 323,
        "semget": 64, "msgget": 68, "migrate_pages": 256, "move_pages": 279, "kcmp": 312,
        "socket": 41, "setpriority": 141, "sched_setparam": 142, "sched_setscheduler": 144, "sched_setaffinity": 203,
        "ioprio_set": 251, "prlimit64": 302, "sched_setattr": 314, "utime": 132, "utimes": 235, "futimesat": 261,
        "utimensat": 280, "mincore": 27, "preadv2": 327, "inotify_init": 253, "inotify_init1": 294,
        "fanotify_init": 300,
    }),
    "aarch64": (0xC00000B7, {
        "shmget": 194, "clone": 220, "ptrace": 117, "pivot_root": 41, "chroot": 51, "mount": 40, "umount2": 39,
        "add_key": 217, "request_key": 218, "keyctl": 219, "unshare": 97, "perf_event_open": 241, "setns": 268,
        "memfd_create": 279, "process_vm_readv": 270, "process_vm_writev": 271, "bpf": 280, "userfaultfd": 282,
        "semget": 190, "msgget": 186, "migrate_pages": 238, "move_pages": 239, "kcmp": 272,
        "socket": 198, "setpriority": 140, "sched_setparam": 118, "sched_setscheduler": 119, "sched_setaffinity": 122,
        "ioprio_set": 30, "prlimit64": 261, "sched_setattr": 274, "utimensat": 88, "mincore": 232, "preadv2": 286,
        "inotify_init1": 26, "fanotify_init": 262,
    }),
}  # fmt: skip
# The same on all kinds: of newer calls.
_NEWER: Final[Mapping[str, int]] = {
    "io_uring_setup": 425, "open_tree": 428, "move_mount": 429, "fsopen": 430, "fsconfig": 431, "fsmount": 432,
    "clone3": 435, "pidfd_getfd": 438, "mount_setattr": 442, "memfd_secret": 447,
    "process_madvise": 440, "process_mrelease": 448, "cachestat": 451,
}  # fmt: skip
# What the first arguments have to be, where a call may be made with these: a process may change its own priority,
# processors and limits, and not those of the process that all its planner's episodes come from. A socket of another
# family than AF_UNIX leaves counts and ports in use for a minute, though there is no network.
_ONLY: Final[Mapping[str, tuple[int, ...]]] = {
    "prlimit64": (0,),
    "sched_setparam": (0,),
    "sched_setscheduler": (0,),
    "sched_setaffinity": (0,),
    "sched_setattr": (0,),
    "setpriority": (0, 0),
    "ioprio_set": (1, 0),
    "socket": (1,),
}
# Flags of clone that make namespaces.
_NAMESPACES: Final = 0x7E020000
# Calls of the x86_64 kernel under other numbers.
_X32: Final = 0x40000000
_LOAD, _IS, _HAS, _AT_LEAST, _RETURN = 0x20, 0x15, 0x45, 0x35, 0x06
_ALLOW, _REFUSE, _MISSING = 0x7FFF0000, 0x00050000 | errno.EPERM, 0x00050000 | errno.ENOSYS


def call_filter() -> bytes:
    """A program for the kernel's filter of system calls (`struct sock_filter`, one after the other).

    Raises InputError on a kind of machine whose numbers of calls are not known here.
    """
    machine = platform.machine().lower().replace("arm64", "aarch64")
    if machine not in _MACHINES:
        raise InputError(
            f"--isolate: the sandbox's filter of system calls is for {' and '.join(_MACHINES)}, and this is {machine}: "
            "use --image, or leave out --isolate"
        )
    arch, found = _MACHINES[machine]
    numbers = {**found, **_NEWER}
    clone, clone3 = numbers.pop("clone"), numbers.pop("clone3")
    only = {numbers.pop(name): wanted for name, wanted in _ONLY.items()}
    # (operation, steps to skip if it holds, steps to skip if not, value)
    steps = [(_LOAD, 0, 0, 4), (_IS, 1, 0, arch), (_RETURN, 0, 0, _REFUSE), (_LOAD, 0, 0, 0)]
    steps += [(_AT_LEAST, 0, 1, _X32), (_RETURN, 0, 0, _REFUSE)]
    # Its flags lie where no filter sees them: who misses it uses clone.
    steps += [(_IS, 0, 1, clone3), (_RETURN, 0, 0, _MISSING)]
    steps += [step for number in sorted(numbers.values()) for step in ((_IS, 0, 1, number), (_RETURN, 0, 0, _REFUSE))]
    for number, wanted in only.items():
        # The lower half of an argument, which is all of it that the kernel looks at.
        asked: list[tuple[int, int, int, int]] = []
        for k, value in enumerate(wanted):
            asked += [(_LOAD, 0, 0, 16 + 8 * k), (_IS, 1, 0, value), (_RETURN, 0, 0, _REFUSE)]
        steps += [(_IS, 0, len(asked) + 1, number), *asked, (_RETURN, 0, 0, _ALLOW)]
    steps += [(_IS, 0, 3, clone), (_LOAD, 0, 0, 16), (_HAS, 0, 1, _NAMESPACES), (_RETURN, 0, 0, _REFUSE)]
    steps += [(_RETURN, 0, 0, _ALLOW)]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)


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
