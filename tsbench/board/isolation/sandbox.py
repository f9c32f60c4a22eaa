"""A planner's program in a sandbox that bubblewrap makes.

What the program starts ends with it, and it ends with the worker.
"""

from __future__ import annotations

import fcntl
import itertools
import os
import resource
import shutil
import socket
import stat
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

from tsbench.board.isolation.kernel_limits import ControlGroup, call_filter
from tsbench.board.isolation.sandbox_contents import (
    LIMITS,
    MEMORY_BYTES,
    SCRATCH_MB,
    PlannerFiles,
    binds_of,
    command_of,
    covered,
    environment_of,
)
from tsbench.core.errors import InputError
from tsbench.core.text import one_line

_ANSWER_S: Final = 60.0
_LONGEST: Final = 200


def asked(*command: str) -> tuple[int, str, str]:
    """Exit status, output, and the last line of what went wrong."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_ANSWER_S, check=False)
    except subprocess.TimeoutExpired:
        return 1, "", f"no answer within {_ANSWER_S:.0f} s"
    except OSError as problem:
        return 1, "", str(problem.strerror)
    lines = [one_line(line) for line in done.stderr.splitlines() if line.strip()]
    return done.returncode, done.stdout, (lines[-1] if lines else f"exit code {done.returncode}")[:_LONGEST]


_HOME: Final = "/scratch"
# Where a sandbox's processes may write, in memory.
_WRITABLE: Final = ("/tmp", "/dev/shm", _HOME)
_APART: Final = ("--unshare-ipc", "--unshare-pid", "--unshare-net", "--unshare-uts", "--unshare-cgroup-try")
# Where root makes the namespaces, the rights that setpriv needs to become nobody. It gives them up.
_BY_ROOT: Final = ("--cap-add", "CAP_SETUID", "--cap-add", "CAP_SETGID", "--cap-add", "CAP_SETPCAP")
_NOBODY: Final = "65534"
_BY_USER: Final = ("--unshare-user", "--uid", _NOBODY, "--gid", _NOBODY)
# Unprivileged ids for a run that root starts: one per sandbox, so that the limit of processes counts its own only.
_FIRST_UID: Final = 0x40000000
_UIDS_OF_A_PROCESS: Final = 256
# Joins the control groups whose files come first, up to "--". The line to the referee arrives as standard input, and is
# descriptor 3 for the program.
_BEGIN: Final = 'while [ "$1" != -- ]; do echo $$ >"$1" || exit; shift; done; shift; exec 3<&0 </dev/null; exec "$@"'
# Above the line's.
_FIRST_DESCRIPTOR: Final = 20
# The kernel's for a new pipe.
_PIPE_BYTES: Final = 1 << 16
_counter = itertools.count()


class _Maker(NamedTuple):
    """bwrap, setpriv and prlimit: paths of programs. as_root: are namespaces made with root's rights?"""

    bwrap: str
    version: str
    setpriv: str
    prlimit: str
    as_root: bool


class Sandbox:
    """A planner's program in a sandbox. line: the socket to it; effects: what holds it, for the run's manifest."""

    def __init__(self, spec: str, hidden: Sequence[Path], files: PlannerFiles, output: int | None = None) -> None:
        """files: copies of the planner's own files. hidden: what it is not to see, such as the run.

        output: a descriptor for what it prints; None: this process's.

        Raises InputError for a file that cannot be executed, and where no sandbox can be made.
        """
        command = command_of(spec, sys.executable)
        maker = _maker()
        arguments = sandbox_arguments(maker, binds_of(files.binds), [str(place) for place in covered(hidden)])
        rules = _readable(call_filter())
        self.line, far_end = socket.socketpair()
        # After all that can fail: otherwise it would stay.
        try:
            self._group: ControlGroup | None = ControlGroup(MEMORY_BYTES, LIMITS["NPROC"])
        except OSError:
            self._group = None
        # Of memory: for all its processes together, where groups can be made.
        limits = sorted({*LIMITS, "MEMORY"} if self._group else LIMITS)
        self.effects: Mapping[str, Any] = {
            "namespaces": maker.version,
            "control_group": self._group is not None,
            "limits": limits,
        }
        # What an earlier planner printed to: nothing that it may have set there is for the next.
        logs = [_as_new(file) for file in (1, 2)] if output is None else []
        groups = [str(file) for file in self._group.members] if self._group else []
        try:
            inside = ["--seccomp", str(rules), "--", *_confined(maker), *command]
            told, failed = logs or (output, output)
            self.process = subprocess.Popen(
                ["/bin/sh", "-c", _BEGIN, "sh", *groups, "--", *arguments, *inside],
                stdin=far_end.fileno(),
                stdout=told,
                stderr=failed,
                pass_fds=(rules,),
                env={**environment_of(), "HOME": _HOME, "TMPDIR": _HOME},
            )
        finally:
            far_end.close()
            for file in (rules, *logs):
                os.close(file)

    def close(self) -> None:
        """End it and all that it has started."""
        self.process.kill()
        self.process.wait()
        if self._group is not None:
            self._group.remove()


def sandbox_arguments(maker: _Maker, binds: Sequence[tuple[str, str]], covers: Sequence[str]) -> list[str]:
    """The command for bubblewrap, up to what it is to start: a file system of what the planner may read.

    binds: (source, place), parents first. covers: what is empty in them.
    """
    found = [maker.bwrap, *_APART, *(_BY_ROOT if maker.as_root else _BY_USER), "--hostname", "sandbox"]
    found += ["--die-with-parent", "--new-session", "--chdir", _HOME, "--dev", "/dev", "--proc", "/proc"]
    # Before the binds, which may lie in them.
    for place in _WRITABLE:
        found += ["--perms", "1777", "--size", str(SCRATCH_MB << 20), "--tmpfs", place]
    shown: list[str] = []
    for source, place in binds:
        path = Path(source)
        # Without this a folder above would be its owner's alone.
        for above in reversed(Path(place).parents[:-1]):
            if not any(above.is_relative_to(one) for one in shown):
                found += ["--dir", str(above)]
        shown.append(place)
        if path.is_symlink():
            found += ["--symlink", str(path.readlink()), place]
        elif path.exists():
            found += ["--ro-bind", source, place]
    for place in covers:
        outside = _source_of(place, binds)
        if outside.is_dir():
            found += ["--size", "4096", "--tmpfs", place, "--remount-ro", place]
        elif outside.is_file():
            found += ["--ro-bind", "/dev/null", place]
    return [*found, "--remount-ro", "/proc", "--remount-ro", "/dev", "--remount-ro", "/"]


def _source_of(place: str, binds: Sequence[tuple[str, str]]) -> Path:
    """What lies outside where a sandbox has `place`; a path that is not there where the sandbox has none."""
    path, source = Path(place), Path(os.devnull, place[1:])
    for outside, inside in binds:
        if path.is_relative_to(inside):
            source = Path(outside) / path.relative_to(inside)
    return source


def _confined(maker: _Maker) -> list[str]:
    """The command before the program: it drops root where root makes the sandbox, and sets the limits there.

    There, because processes are counted for each namespace of users, or each unprivileged id, and never for root.
    """
    limits = {"CORE": 0, **LIMITS}
    found = [maker.prlimit]
    for name, most in limits.items():
        hard = resource.getrlimit(getattr(resource, f"RLIMIT_{name}"))[1]
        value = most if hard == resource.RLIM_INFINITY else min(most, hard)
        found.append(f"--{name.lower()}={value}:{value}")
    if not maker.as_root:
        return [*found, "--"]
    own = str(_FIRST_UID + os.getpid() * _UIDS_OF_A_PROCESS + next(_counter) % _UIDS_OF_A_PROCESS)
    nobody = ["--reuid", own, "--regid", own, "--clear-groups", "--bounding-set=-all", "--inh-caps=-all"]
    return [maker.setpriv, *nobody, "--", *found, "--"]


def _as_new(file: int) -> int:
    """A new descriptor for the target of a file. For a pipe it restores mode, times and size, which may have changed.

    Opened anew, so that flags, signals and locks of an earlier one are not its.
    """
    if not stat.S_ISFIFO(os.fstat(file).st_mode):
        return os.dup(file)
    with suppress(OSError):
        os.fchmod(file, 0o600)
        os.utime(file)
        fcntl.fcntl(file, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    return os.open(f"/proc/self/fd/{file}", os.O_WRONLY | os.O_CLOEXEC)


def _readable(content: bytes) -> int:
    """A descriptor from which a program reads a few bytes."""
    end, start = os.pipe()
    os.write(start, content)
    os.close(start)
    above = fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, _FIRST_DESCRIPTOR)
    os.close(end)
    return above


@cache
def _maker() -> _Maker:
    """What makes sandboxes on this machine, tried once. Raises InputError where something is missing or forbidden."""
    programs = {name: shutil.which(name) for name in ("bwrap", "setpriv", "prlimit")}
    missing = [name for name, path in programs.items() if path is None]
    if missing:
        raise InputError(
            f"--isolate: {', '.join(missing)} not found on PATH: install bubblewrap (0.7 or newer) and util-linux, for "
            "example by apt-get install bubblewrap util-linux; or use --image, or leave out --isolate"
        )
    bwrap, setpriv, prlimit = (str(path) for path in programs.values())
    _, version, _ = asked(bwrap, "--version")
    maker = _Maker(bwrap, one_line(version), setpriv, prlimit, as_root=os.geteuid() == 0)
    binds = [(place, place) for place in ("/usr", "/bin", "/lib", "/lib64")]
    status, _, problem = asked(*sandbox_arguments(maker, binds, ()), "--", *_confined(maker), "true")
    if status != 0:
        raise InputError(
            f"--isolate: bubblewrap makes no sandbox here ({problem}): docs/isolation.md says what may forbid it; use "
            "--image, or leave out --isolate"
        )
    return maker
