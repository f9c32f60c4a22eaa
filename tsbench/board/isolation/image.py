"""A planner's process in a container of an image that the user names, by Docker or Podman."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import gettempdir
from typing import Any, Final

from tsbench.board.isolation.sandbox import asked
from tsbench.board.isolation.sandbox_contents import (
    LIMITS,
    MEMORY_BYTES,
    SCRATCH_MB,
    PlannerFiles,
    arithmetic,
    command_of,
)
from tsbench.core.errors import InputError
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.planners.registry import source_of
from tsbench.run.execution.own_folder import SANDBOX, OwnFolder

_ENGINES: Final = ("docker", "podman")
# Where the folder with the line's socket is, in the container.
_LINE: Final = "/tsbench-line"
_SOCKET: Final = "socket"
_LABEL: Final = "tsbench.folder"
_NOBODY: Final = 65534
# Images are large: the first container of one may take long to come up.
_START_S: Final = 120.0


class Container:
    """A planner's program in a container. line: the socket to it; effects: what holds it, for the run's manifest."""

    def __init__(self, image: str, spec: str, files: PlannerFiles, output: int | None = None) -> None:
        """output: a descriptor for what it prints; None: this process's.

        Raises InputError: no engine, one that does not answer, no such image, or a program that does not come up.
        """
        self._engine = find_engine()
        self.effects: Mapping[str, Any] = {
            "namespaces": self._engine,
            "limits": sorted({*LIMITS, "MEMORY"}),
            "image": image,
            "image_id": image_id(self._engine, image),
        }
        command = command_of(spec, python="python3")
        self.folder = OwnFolder(SANDBOX)
        self._name = self.folder.path.name
        remove_abandoned(self._engine)
        line = self.folder.path / "line"
        line.mkdir()
        with socket.socket(socket.AF_UNIX) as waiting:
            waiting.bind(str(line / _SOCKET))
            # For any user in the container; the folder around it keeps all others out.
            (line / _SOCKET).chmod(0o666)
            line.chmod(0o755)
            waiting.listen(1)
            place, mounts = self.folder.path, files.binds
            arguments = run_arguments(self._engine, image, self._name, place, spec, command, mounts)
            self.process = subprocess.Popen(
                [self._engine, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
            # A worker that ends as it should, without a word to its planner, ends the container, too.
            self._release = weakref.finalize(self, _ended, self._engine, self._name, self.process)
            self.line = self._accepted(waiting, image)

    def _accepted(self, waiting: socket.socket, image: str) -> socket.socket:
        step = 0.1
        waiting.settimeout(step)
        for _ in range(round(_START_S / step)):
            with suppress(TimeoutError):
                line, _ = waiting.accept()
                line.settimeout(None)
                return line
            status = self.process.poll()
            if status is not None:
                self.close()
                raise InputError(
                    f"--image {image}: the container ended with exit code {status} before its planner connected: it "
                    "needs python3 with tsbench, or a program that connects to TSBENCH_LINE; see its messages above"
                )
        self.close()
        raise InputError(f"--image {image}: its planner has not connected to TSBENCH_LINE within {_START_S:.0f} s")

    def close(self) -> None:
        """End the container and all that runs in it."""
        self._release()
        self.folder.remove()


def _ended(engine: str, name: str, process: subprocess.Popen[bytes]) -> None:
    asked(engine, "rm", "--force", name)
    process.kill()
    process.wait()


def find_engine() -> str:
    """The first of docker and podman that answers. Raises InputError where none does."""
    reasons = []
    for engine in _ENGINES:
        if shutil.which(engine) is None:
            continue
        status, _, problem = asked(engine, "info")
        if status == 0:
            return engine
        reasons.append(f"{engine} does not answer ({problem})")
    if reasons:
        raise InputError(f"--image: {'; '.join(reasons)}: start its service, or leave out --image")
    raise InputError("--image: neither docker nor podman is on PATH: install one, or leave out --image")


def image_id(engine: str, image: str) -> str:
    """The hash of an image's content. Raises InputError where it is not on this machine."""
    status, told, problem = asked(engine, "image", "inspect", "--format", "{{.Id}}", image)
    if status != 0:
        raise InputError(
            f"--image {image}: {engine} has no such image here ({problem}): {engine} pull {image}, or build it"
        )
    return told.strip().removeprefix("sha256:")


def run_arguments(
    engine: str,
    image: str,
    name: str,
    folder: Path,
    spec: str,
    command: Sequence[str],
    mounts: Sequence[tuple[Path, Path]],
) -> list[str]:
    """The arguments of `docker run` or `podman run`.

    folder: of the sandbox, with the line's folder in it. mounts: copies of the planner's files, and where they are to
    stand; what is installed has to be in the image. Raises InputError for a path that a mount cannot name.
    """
    for place in (folder, *(path for mount in mounts for path in mount)):
        # A mount is words between commas.
        if "," in str(place):
            raise InputError(f"--image {image}: {place}: an engine mounts no path with a comma: rename it")
    uid, gid = (os.getuid(), os.getgid()) if os.getuid() != 0 else (_NOBODY, _NOBODY)
    environment = {
        **arithmetic(),
        "TSBENCH_LINE": f"{_LINE}/{_SOCKET}",
        "HOME": "/tmp",
        "TMPDIR": "/tmp",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1",
    }
    if not (PlannerSpec(spec).program or source_of(spec).endswith(".py")):
        # A module's package, or the module itself, is found in the folder that it is in.
        environment["PYTHONPATH"] = os.pathsep.join(str(place.parent) for _, place in mounts)
    return [
        "run", "--rm", "--pull=never", f"--name={name}", f"--label={_LABEL}={folder}", "--network=none", "--read-only",
        "--cap-drop=ALL", "--security-opt=no-new-privileges", "--hostname=sandbox", "--log-driver=none",
        f"--memory={MEMORY_BYTES}", f"--memory-swap={MEMORY_BYTES}", f"--pids-limit={LIMITS['NPROC']}",
        f"--ulimit=cpu={LIMITS['CPU']}", f"--ulimit=nofile={LIMITS['NOFILE']}", f"--ulimit=fsize={LIMITS['FSIZE']}",
        "--ulimit=core=0", f"--shm-size={SCRATCH_MB}m", f"--tmpfs=/tmp:rw,nosuid,nodev,size={SCRATCH_MB}m,mode=1777",
        "--workdir=/tmp", f"--user={uid}:{gid}",
        # Without root Podman's own root is the user: who runs in there is to be the one whose files are mounted.
        *(["--userns=keep-id"] if engine == "podman" and os.geteuid() != 0 else []),
        f"--mount=type=bind,source={folder / 'line'},target={_LINE},readonly",
        *(f"--mount=type=bind,source={copy},target={place},readonly" for copy, place in mounts),
        *(f"--env={key}={value}" for key, value in environment.items()),
        f"--entrypoint={command[0]}", image, *command[1:],
    ]  # fmt: skip


def remove_abandoned(engine: str) -> None:
    """Remove containers whose worker was killed: the folder that they were started with is gone."""
    _, told, _ = asked(
        engine, "ps", "--all", "--filter", f"label={_LABEL}", "--format", f'{{{{.Names}}}} {{{{.Label "{_LABEL}"}}}}'
    )
    for line in told.splitlines():
        name, _, folder = line.partition(" ")
        # Of another user's, or another place for temporary files, nothing can be said.
        if Path(folder).parent == Path(gettempdir()) and not Path(folder).exists():
            asked(engine, "rm", "--force", name)
