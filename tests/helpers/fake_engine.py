"""Stands for `docker`: takes the arguments of a container, and runs its program in this machine's Python in its place.

In the folder that it is in, it notes its calls; files there say how it is: `down`, `left` (what `ps` lists).
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

HERE = Path(sys.argv[0]).parent
IMAGES = {"planner:1": "sha256:" + "ab" * 32, "broken:1": "sha256:" + "cd" * 32}


def fail(text: str, status: int = 1) -> None:
    print(text, file=sys.stderr)
    sys.exit(status)


def run(arguments: list[str]) -> None:
    options: dict[str, list[str]] = {}
    while arguments[0].startswith("-"):
        name, _, value = arguments.pop(0).partition("=")
        options.setdefault(name, []).append(value)
    image, *rest = arguments
    if image not in IMAGES:
        fail(f"Unable to find image '{image}' locally", 125)
    if image == "broken:1":
        fail("python3: No module named tsbench", 1)
    mounts = [dict(part.partition("=")[::2] for part in mount.split(",")) for mount in options["--mount"]]
    assert all("readonly" in mount and Path(mount["source"]).exists() for mount in mounts)
    environment = dict(one.split("=", 1) for one in options["--env"])
    for mount in mounts:
        line = environment["TSBENCH_LINE"]
        environment["TSBENCH_LINE"] = line.replace(f"{mount['target']}/", f"{mount['source']}/")
    # What is installed here is what is installed in the image.
    path = [environment.get("PYTHONPATH"), os.environ.get("PYTHONPATH")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, path))
    program = options["--entrypoint"][0]
    program = sys.executable if program == "python3" else program
    (HERE / f"{options['--name'][0]}.pid").write_text(str(os.getpid()))
    os.chdir(tempfile.gettempdir())
    os.execve(program, [program, *rest], environment)


def main(command: str, *arguments: str) -> None:
    with (HERE / "calls").open("a") as calls:
        calls.write(json.dumps([command, *arguments]) + "\n")
    if (HERE / "down").exists():
        fail("Cannot connect to the Docker daemon at unix:///var/run/docker.sock. Is the docker daemon running?")
    if command == "image":
        if arguments[-1] not in IMAGES:
            fail(f"Error response from daemon: No such image: {arguments[-1]}")
        print(IMAGES[arguments[-1]])
    elif command == "ps":
        if (HERE / "left").exists():
            print((HERE / "left").read_text(), end="")
    elif command == "rm":
        file = HERE / f"{arguments[-1]}.pid"
        if file.exists():
            with suppress(ProcessLookupError):
                os.kill(int(file.read_text()), signal.SIGKILL)
            file.unlink()
    elif command == "run":
        run(list(arguments))


if __name__ == "__main__":
    main(*sys.argv[1:])
