"""Scenarios that need no SUMO, and the command line run on them."""

from __future__ import annotations

import importlib
import io
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import driver
import pytest
from patience import HANG_S, eventually

from tsbench.core.machine import children_of
from tsbench.core.paths import data_root
from tsbench.scenarios.spec import ScenarioSpec

HERE = Path(__file__).parent
# The hand-made episodes are shared with the tests of the metrics.
episode_builders = importlib.import_module("episode_builders")
ROOT = HERE.parent.parent
TYPES = (("yield", "priority", "2.4", None), ("speed_limit", "speed", "3.24", 40.0))


def spec(kind: int, map_number: int, variant: int) -> ScenarioSpec:
    name, group, code, value = TYPES[kind]
    net = f"nets/{name}-{map_number}.net.xml"
    return ScenarioSpec(
        scenario_id=f"{name}-{map_number:03d}-{variant}", scenario_type=name, group=group, sign_code=code,
        sign_value=value, map_id=f"map-{kind}-{map_number}", family="corridor", shape="straight", slot="",
        variant=variant, split="test", seed=100 * kind + 10 * map_number + variant, initial_speed=5.0,
        route_length=400.0, density=0.1, drivers=2, layout=0, horizon=600, net=net,
        additional=f"scenes/{name}-{map_number}-{variant}.add.xml",
        net_sha256="0" * 64, additional_sha256="1" * 64,
    )  # fmt: skip


def specs(maps: int = 2, variants: int = 10) -> list[ScenarioSpec]:
    return [spec(k, m, v) for k in range(len(TYPES)) for m in range(maps) for v in range(variants)]


def workers_of(process: subprocess.Popen[str]) -> list[int]:
    """Process ids of the workers of a run, each the child of its reaper."""
    return [pid for reaper in children_of(process.pid) for pid in children_of(reaper) if _is_worker(pid)]


def assert_gone(pids: list[int]) -> None:
    """No worker of these is left, however late a busy machine ends a process."""
    eventually(lambda: not any(_is_worker(pid) for pid in pids))


def _is_worker(pid: int) -> bool:
    try:
        # Empty for a process that has ended and was not waited for yet.
        return b"tsbench.run.execution.worker_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return False


def _hold_ctrl_c() -> None:
    """In a new process: Ctrl-C waits until the driver lets it through; a shell's `&` would have it ignored."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _by_one_worker(arguments: tuple[str, ...]) -> list[str]:
    """Each more takes half a second to start; tests about several, or about a cluster, ask for them."""
    asked = arguments[0] != "run" or not {"--workers", "--executor"}.isdisjoint(arguments)
    return [*arguments, *(() if asked else ("--workers", "1"))]


class Bench:
    """Runs the command line on the fake runner."""

    def __init__(self, data: Path, folder: Path) -> None:
        self.data, self.folder = data, folder
        path = [str(HERE), str(HERE.parent), str(HERE.parent / "metrics"), os.environ.get("PYTHONPATH", "")]
        self.env = {
            **os.environ,
            "TSBENCH_DATA": str(data),
            "TSBENCH_TEST_MARK": str(folder / "mark"),
            "PYTHONPATH": os.pathsep.join(path),
        }

    def command(self, *arguments: str) -> list[str]:
        return [sys.executable, str(HERE / "driver.py"), *_by_one_worker(arguments)]

    def start(self, *arguments: str, **env: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            self.command(*arguments), cwd=self.folder, env={**self.env, **env}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            preexec_fn=_hold_ctrl_c,
        )  # fmt: skip

    def start_paused(self, lines: int, *arguments: str, **env: str) -> subprocess.Popen[str]:
        """A run that stands still with so many episodes finished, until it is killed or `go` is called.

        However slow the machine is: it neither comes late to that point nor goes past it.
        """
        mark = Path(self.env["TSBENCH_TEST_MARK"])
        for suffix in (".paused", ".go"):
            mark.with_suffix(suffix).unlink(missing_ok=True)
        process = self.start(*arguments, TSBENCH_TEST_PAUSE=str(lines), **env)
        try:
            eventually(mark.with_suffix(".paused").exists, process)
        except AssertionError:
            process.kill()
            raise AssertionError(f"it did not come to {lines} episodes: {process.communicate()}") from None
        return process

    def go(self, process: subprocess.Popen[str], expect: int = 0) -> tuple[str, str]:
        """Let a paused run go on to its end, and say what it says. expect: the exit code that it has to end with."""
        Path(self.env["TSBENCH_TEST_MARK"]).with_suffix(".go").touch()
        out, err = process.communicate(timeout=HANG_S)
        assert process.returncode == expect, (out, err)
        return out, err

    def run(self, *arguments: str, expect: int = 0, **env: str) -> subprocess.CompletedProcess[str]:
        """The same within this process, which has imported everything already."""
        out, err = io.StringIO(), io.StringIO()
        path = list(sys.path)
        with pytest.MonkeyPatch.context() as patch:
            for name in ("TSBENCH_DATA", "TSBENCH_TEST_MARK"):
                patch.setenv(name, self.env[name])
            for name, value in env.items():
                patch.setenv(name, value)
            patch.syspath_prepend(str(HERE))
            patch.chdir(self.folder)
            data_root.cache_clear()
            with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
                driver.main(_by_one_worker(arguments))
        sys.path[:] = path
        data_root.cache_clear()
        assert ended.value.code == expect, f"exit {ended.value.code}\n{out.getvalue()}\n{err.getvalue()}"
        return subprocess.CompletedProcess(arguments, expect, out.getvalue(), err.getvalue())

    def refused(self, *arguments: str) -> str:
        """The one line with which the command line refuses, after "error: "."""
        told = self.run(*arguments, expect=2).stderr
        assert told.startswith("error: ")
        assert told.count("\n") == 1
        return told.removeprefix("error: ")
