"""Makes a sandbox and starts a planner's program in it; whatever that starts ends with it, and it ends with the worker.

python -I -S sandbox.py LINE_FD SETTINGS

SETTINGS is JSON: `settings_of` in `places` says what stands in it. Nothing of ours is imported, so that this starts in
an instant. The line to the referee becomes descriptor 3, here and in the program. The first message on it (kind 1) says
what of the sandbox took effect: the program cannot say that for itself, as it does not run yet.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import platform
import resource
import signal
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

LINE = 3
_NEWNS, _NEWUSER, _NEWPID, _NEWNET, _NEWIPC, _NEWUTS = (
    0x20000, 0x10000000, 0x20000000, 0x40000000, 0x08000000, 0x04000000
)  # fmt: skip
_APART = _NEWNS | _NEWPID | _NEWNET | _NEWIPC | _NEWUTS
_RDONLY, _NOSUID, _NODEV, _NOEXEC, _REMOUNT, _BIND, _REC, _PRIVATE = (
    1, 2, 4, 8, 32, 0x1000, 0x4000, 0x40000
)  # fmt: skip
_ATIME = 0x400 | 0x800
_DETACH = 2
_PR_SET_PDEATHSIG, _PR_CAPBSET_DROP, _PR_SET_DUMPABLE, _PR_SET_NO_NEW_PRIVS = 1, 24, 4, 38
# Of a kind of machine: its number in seccomp's data, and the numbers of system calls.
_MACHINES = {
    "x86_64": (0xC000003E, {
        "shmget": 29, "clone": 56, "pivot_root": 155, "chroot": 161, "mount": 165, "umount2": 166, "add_key": 248,
        "request_key": 249, "keyctl": 250, "unshare": 272, "perf_event_open": 298, "setns": 308, "memfd_create": 319,
        "bpf": 321, "userfaultfd": 323,
    }),
    "aarch64": (0xC00000B7, {
        "shmget": 194, "clone": 220, "pivot_root": 41, "chroot": 51, "mount": 40, "umount2": 39, "add_key": 217,
        "request_key": 218, "keyctl": 219, "unshare": 97, "perf_event_open": 241, "setns": 268, "memfd_create": 279,
        "bpf": 280, "userfaultfd": 282,
    }),
}  # fmt: skip
# The same on all kinds: of newer calls.
_NEWER = {
    "io_uring_setup": 425, "open_tree": 428, "move_mount": 429, "fsopen": 430, "fsconfig": 431, "fsmount": 432,
    "clone3": 435, "mount_setattr": 442, "memfd_secret": 447,
}  # fmt: skip
# Flags of clone that make namespaces.
_NAMESPACES = 0x7E020000
_PR_SET_SECCOMP, _FILTER = 22, 2
_LOAD, _IS, _HAS, _AT_LEAST, _RETURN = 0x20, 0x15, 0x45, 0x35, 0x06
_ALLOW, _REFUSE, _MISSING = 0x7FFF0000, 0x00050000 | errno.EPERM, 0x00050000 | errno.ENOSYS
# Calls of the x86_64 kernel under other numbers.
_X32 = 0x40000000
_MOST_CAPABILITIES = 64
# Ids of nobody: one for each sandbox, so that the limit of processes counts its own only.
_HOME = "/scratch"
_HOST_NAME = b"sandbox"
_FIRST_UID = 0x40000000

_system = ctypes.CDLL(None, use_errno=True)


def _call(name: str, *arguments: Any) -> None:
    if getattr(_system, name)(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{name}: {os.strerror(number)}")


def _mount(source: str, target: str, kind: str | None, flags: int, data: str = "") -> None:
    _call(
        "mount", source.encode(), target.encode(), kind and kind.encode(), ctypes.c_ulong(flags), data.encode()
    )  # fmt: skip


def separate() -> str:
    """Makes own namespaces; returns "user" or "root" (who made them), "" where the kernel does not allow it."""
    if os.geteuid() == 0:
        with suppress(OSError):
            _call("unshare", _APART)
            return "root"
    uid, gid = os.geteuid(), os.getegid()
    try:
        _call("unshare", _APART | _NEWUSER)
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{uid} {uid} 1")
        Path("/proc/self/gid_map").write_text(f"{gid} {gid} 1")
    except OSError:
        return ""
    return "user"


def build_root(settings: dict[str, Any]) -> bool:
    """A file system of what the planner may read, and nothing else; becomes the root. Has it a /proc?"""
    root = Path(settings["root"])
    _mount("none", "/", None, _REC | _PRIVATE)
    _mount("tmpfs", str(root), "tmpfs", _NOSUID | _NODEV, "mode=755,size=16m")
    # Before the binds, which may lie in them.
    for name in ("tmp", "dev/shm", _HOME[1:]):
        (root / name).mkdir(parents=True)
        _mount("tmpfs", str(root / name), "tmpfs", _NOSUID | _NODEV, f"mode=1777,size={settings['scratch']}")
    for source, place in settings["binds"]:
        _bind(Path(source), Path(place), root)
    for place in settings["covers"]:
        covered = root / place[1:]
        if covered.is_dir():
            _mount("tmpfs", str(covered), "tmpfs", _NOSUID | _NODEV | _RDONLY, "mode=755,size=4k")
        elif covered.is_file():
            _mount("/dev/null", str(covered), None, _BIND)
    # Read-only: they can be written to, and their owner and mode, which are those outside, stay.
    for name in ("null", "zero", "urandom", "random"):
        _bind(Path("/dev") / name, Path("/dev") / name, root)
    (root / "proc").mkdir()
    proc = False
    # As long as the old one is in sight: without it nobody but root may have a new one.
    with suppress(OSError):
        _mount("proc", str(root / "proc"), "proc", _NOSUID | _NODEV | _NOEXEC | _RDONLY)
        proc = True
    os.chdir(root)
    _call("syscall", ctypes.c_long(_MACHINES[_machine()][1]["pivot_root"]), b".", b".")
    _call("umount2", b".", _DETACH)
    os.chdir("/")
    _mount("tmpfs", "/", None, _REMOUNT | _BIND | _RDONLY | _NOSUID | _NODEV)
    return proc


def _bind(source: Path, at: Path, root: Path) -> None:
    """A file or folder at a place below a root, read-only; nothing where there is none."""
    place = root / str(at)[1:]
    place.parent.mkdir(parents=True, exist_ok=True)
    if source.is_symlink():
        place.symlink_to(source.readlink())
        return
    if not source.exists():
        return
    if source.is_dir():
        place.mkdir(exist_ok=True)
    else:
        place.touch()
    _mount(str(source), str(place), None, _BIND | _REC)
    # Flags that the owner of the mount has set may not be taken off it.
    kept = os.statvfs(place).f_flag & (_NODEV | _NOEXEC | _ATIME)
    _mount("none", str(place), None, _REMOUNT | _BIND | _RDONLY | _NOSUID | kept)


def limit(limits: dict[str, int], processes: bool) -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for name, most in limits.items():
        if name != "NPROC" or processes:
            kind = getattr(resource, f"RLIMIT_{name}")
            hard = resource.getrlimit(kind)[1]
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (most, most))


def give_up_rights(nobody: bool) -> None:
    """Drops all rights that made the sandbox. nobody: becomes a user that does not exist."""
    for one in range(_MOST_CAPABILITIES):
        _system.prctl(_PR_CAPBSET_DROP, one, 0, 0, 0)
    if nobody:
        own = _FIRST_UID + int(os.environ["TSBENCH_SANDBOX"])
        os.setgroups([])
        os.setresgid(own, own, own)
        os.setresuid(own, own, own)
    else:
        # Root's own files only root may read: it keeps its name, and none of its rights.
        # Header of version 3, and no capability in any of the three sets.
        _system.capset(struct.pack("<Ii", 0x20080522, 0), bytes(24))
    _call("prctl", _PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)


def _machine() -> str:
    return platform.machine().lower().replace("arm64", "aarch64")


class _Program(ctypes.Structure):
    _fields_ = (("count", ctypes.c_ushort), ("steps", ctypes.c_char_p))


def refuse_calls() -> bool:
    """No keys of the kernel's, which outlive an episode, no new namespaces or mounts, nothing that watches the kernel.

    And no memory that no limit counts: System V's, and files that lie in no folder. /dev/shm stays, which is limited.
    A filter of system calls, for all that this process starts. False where the kernel has none, or for this machine.
    """
    if _machine() not in _MACHINES:
        return False
    arch, numbers = _MACHINES[_machine()]
    numbers = numbers | _NEWER
    clone, clone3 = numbers.pop("clone"), numbers.pop("clone3")
    refused = sorted(numbers.values())
    # (operation, steps to skip if it holds, steps to skip if not, value)
    steps = [(_LOAD, 0, 0, 4), (_IS, 1, 0, arch), (_RETURN, 0, 0, _REFUSE), (_LOAD, 0, 0, 0)]
    steps += [(_AT_LEAST, 0, 1, _X32), (_RETURN, 0, 0, _REFUSE)]
    # Its flags lie where no filter sees them: who misses it uses clone.
    steps += [(_IS, 0, 1, clone3), (_RETURN, 0, 0, _MISSING)]
    steps += [step for number in refused for step in ((_IS, 0, 1, number), (_RETURN, 0, 0, _REFUSE))]
    steps += [(_IS, 0, 3, clone), (_LOAD, 0, 0, 16), (_HAS, 0, 1, _NAMESPACES), (_RETURN, 0, 0, _REFUSE)]
    steps += [(_RETURN, 0, 0, _ALLOW)]
    code = b"".join(struct.pack("=HBBI", *step) for step in steps)
    program = _Program(len(steps), code)
    return bool(_system.prctl(_PR_SET_SECCOMP, _FILTER, ctypes.byref(program), 0, 0) == 0)


def tell(effects: dict[str, Any]) -> None:
    """The first message, as `protocol` has them: its one field is text."""
    data = json.dumps(effects).encode()
    size = len(data) + -len(data) % 16
    os.write(LINE, struct.pack(f"<III12x{size}s", 16 + size, 1, len(data), data))


def inside(settings: dict[str, Any], made_by: str) -> None:
    """In the process that becomes the planner's."""
    effects: dict[str, Any] = {"namespaces": "", "files": False, "proc": False}
    if made_by:
        effects |= {"namespaces": made_by, "files": True, "proc": build_root(settings)}
        _call("sethostname", _HOST_NAME, ctypes.c_size_t(len(_HOST_NAME)))
        home = _HOME
    else:
        home = settings["home"]
    os.chdir(home)
    # Counted for each namespace of users or each id of nobody, and never for root.
    nobody = made_by == "root"
    processes = nobody or (made_by == "user" and os.geteuid() != 0)
    limit(settings["limits"], processes)
    give_up_rights(nobody)
    _system.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    effects["limits"] = sorted(n for n in settings["limits"] if n != "NPROC" or processes)
    effects |= {"no_new_privs": True, "refused_calls": refuse_calls()}
    null = os.open("/dev/null", os.O_RDONLY)
    os.dup2(null, 0)
    tell(effects)
    os.closerange(LINE + 1, 1 << 16)
    os.set_inheritable(LINE, True)
    environment = {**settings["environment"], "HOME": home, "TMPDIR": home}
    command = settings["command"]
    os.execve(command[0], command, environment)


def main(settings: dict[str, Any]) -> None:
    os.setsid()
    _system.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != settings["parent"]:
        return
    os.environ["TSBENCH_SANDBOX"] = str(os.getpid())
    made_by = separate()
    child = os.fork()
    if child == 0:
        try:
            inside(settings, made_by)
        except OSError as problem:
            tell({"problem": str(problem)})
        os._exit(127)
    os.closerange(LINE, 1 << 16)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    os._exit(code if code >= 0 else 128 - code)


if __name__ == "__main__":
    os.dup2(int(sys.argv[1]), LINE)
    os.closerange(LINE + 1, 1 << 16)
    main(json.loads(sys.argv[2]))
