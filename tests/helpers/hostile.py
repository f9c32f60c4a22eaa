"""Planners that cheat or attack. `HONEST` drives as they do where nothing comes of it.

python hostile.py PLACE NAME SCENARIO...: drives them here ("here") or in a cell ("cell"), and prints what came of it.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import signal
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from tsbench.planners.base import Control

ROOT = Path(__file__).resolve().parents[2]


class Honest:
    """Rolls on; whoever has won something brakes."""

    won = False

    def reset(self, context):
        self.won = False
        with suppress(Exception):
            self.won = bool(self.attack(context))

    def attack(self, context):
        return False

    def act(self, observation):
        return Control(-3.0 if self.won else 0.0, 0.0)


class ByTable(Honest):
    """The target through `context.seed` and the table on disk."""

    def attack(self, context):
        from tsbench.core.seeds import planner_seed
        from tsbench.scenarios.table import read_table, table_path

        return [
            row.sign_code
            for row in read_table(table_path("dev"))
            if planner_seed(row.pair_name) == context.seed
        ]


class ByFile(Honest):
    """Any table or scene below the data folder."""

    def attack(self, context):
        return [*ROOT.glob("scenarios/*.parquet"), *ROOT.glob("sumo_nets/*"), *ROOT.glob(".git/*")]


class ByGc(Honest):
    """The scene with its target, found among all objects."""

    def attack(self, context):
        return [one for one in gc.get_objects() if type(one).__name__ in ("Scene", "Episode", "ScenarioSpec")]


class Teleports(Honest):
    def attack(self, context):
        from dataclasses import replace

        from tsbench.episode import runner

        runner.advance = lambda motion, *_: replace(motion, x=motion.x + 0.5)


class RemovesTraffic(Honest):
    def act(self, observation):
        import libsumo

        with suppress(Exception):
            for one in libsumo.vehicle.getIDList():
                if one != "ego":
                    libsumo.vehicle.remove(one)
        return super().act(observation)


class PatchesScorer(Honest):
    def attack(self, context):
        from dataclasses import replace

        from tsbench.run.log import score

        true = score.make_record
        score.make_record = lambda *a: replace(r := true(*a), row={**r.row, "scd": not r.row["scd"]})


class PatchesEnding(Honest):
    def attack(self, context):
        from tsbench.episode.outcome import Outcome, TerminationCheck

        TerminationCheck.at = lambda *_: Outcome.ARRIVED


class PatchesMonitors(Honest):
    def attack(self, context):
        from dataclasses import replace

        from tsbench.rules import registry

        finish = registry.Monitors.finish
        clean = lambda said: said._replace(target=replace(said.target, violations=()), needless=())  # noqa: E731
        registry.Monitors.finish = lambda self: clean(finish(self))


class Exits(Honest):
    def act(self, observation):
        os._exit(3)


class Crashes(Honest):
    def act(self, observation):
        ctypes.string_at(0)


class Raises(Honest):
    def act(self, observation):
        raise KeyboardInterrupt


def _line():
    return next(fd for fd in range(3, 64) if _is_socket(fd))


def _is_socket(fd):
    with suppress(OSError):
        return str(Path(f"/proc/self/fd/{fd}").readlink()).startswith("socket")
    return False


class Garbage(Honest):
    def act(self, observation):
        os.write(_line(), b"\xff" * 64)
        return super().act(observation)


class Oversize(Honest):
    def act(self, observation):
        os.write(_line(), struct.pack("<II", 1 << 30, 9))
        return super().act(observation)


class Counts(Honest):
    """A field that says it has more items than there are."""

    def act(self, observation):
        os.write(_line(), struct.pack("<IIIdd", 20, 9, 4_000_000_000, 0.0, 0.0))
        return super().act(observation)


class Twice(Honest):
    """An answer beside the answer, as for the next tick."""

    def act(self, observation):
        from tsbench.run.isolation.moments import command_message

        os.write(_line(), 2 * command_message(Control(1.0, 0.0)))
        time.sleep(60.0)


class HangsUp(Honest):
    def act(self, observation):
        os.close(_line())
        return super().act(observation)


class NaN(Honest):
    def act(self, observation):
        return Control(float("nan"), 0.0)


class LongPlan(Honest):
    def act(self, observation):
        return Control(0.0, 0.0, plan=np.zeros((1_000_000, 2)))


class OddIntent(Honest):
    def act(self, observation):
        return Control(0.0, 0.0, intent=("nowhere",))


class NoCommand(Honest):
    def act(self, observation):
        return "faster"


class ForkBomb(Honest):
    def attack(self, context):
        children = 0
        while children < 2000:
            if os.fork() == 0:
                time.sleep(30.0)
                os._exit(0)
            children += 1
        return True


class Threads(Honest):
    def attack(self, context):
        for _ in range(2000):
            threading.Thread(target=time.sleep, args=(30.0,), daemon=True).start()
        return True


class MemoryHog(Honest):
    def attack(self, context):
        return len(bytearray(6 << 30))


class DiskHog(Honest):
    def attack(self, context):
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        with Path("hog").open("wb") as file:
            for _ in range(100):
                file.write(bytes(8 << 20))
        return True


class OpensFiles(Honest):
    def attack(self, context):
        return [os.open("/dev/null", os.O_RDONLY) for _ in range(5000)]


class LiftsLimits(Honest):
    def attack(self, context):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        return True


class SeesProcesses(Honest):
    def attack(self, context):
        return [one for one in Path("/proc").glob("[0-9]*") if one.name != str(os.getpid())]


class KillsAll(Honest):
    def attack(self, context):
        os.kill(-1, signal.SIGKILL)


class StopsParent(Honest):
    def attack(self, context):
        if os.getppid() > 0:
            os.kill(os.getppid(), signal.SIGSTOP)
        return os.getppid() > 0


class Ptraces(Honest):
    def attack(self, context):
        attach = 16
        return any(ctypes.CDLL(None).ptrace(attach, pid, 0, 0) == 0 for pid in range(2, 40_000))


class ReadsParent(Honest):
    def attack(self, context):
        return Path(f"/proc/{os.getppid()}/environ").read_bytes()


class Inherits(Honest):
    """A descriptor of somebody else's."""

    def attack(self, context):
        ours = ("socket", "/dev/null", "pipe", "/proc", "anon_inode")
        links = []
        for one in Path("/proc/self/fd").iterdir():
            with suppress(OSError):
                links.append(str(one.readlink()))
        return [link for link in links if not link.startswith(ours)]


class WritesRun(Honest):
    def attack(self, context):
        for folder in (
            ROOT / "tests",
            ROOT / "runs",
            ROOT / "tsbench",
            Path(sys.prefix),
            Path("/etc"),
            Path("/"),
        ):
            with suppress(OSError):
                (folder / "stray").write_text("mine")
                folder.joinpath("stray").unlink()
                return True
        return False


class Connects(Honest):
    def attack(self, context):
        with socket.create_connection(
            ("127.0.0.1", int(Path(__file__).with_suffix(".port").read_text())), 1.0
        ):
            return True


class BecomesRoot(Honest):
    def attack(self, context):
        os.setuid(0)
        return True


class Uncovers(Honest):
    """Takes the covers off the data, with rights of a namespace of its own."""

    def attack(self, context):
        system = ctypes.CDLL(None)
        system.unshare(0x10000000 | 0x20000)
        system.umount2(str(ROOT / "scenarios").encode(), 2)
        system.umount2(b"/", 2)
        return [*ROOT.glob("scenarios/*.parquet")]


class Environment(Honest):
    """What the environment of the run tells."""

    def attack(self, context):
        return [name for name in os.environ if "SECRET" in name]


class Hangs(Honest):
    def act(self, observation):
        while True:
            time.sleep(1.0)


class Spins(Honest):
    def act(self, observation):
        while True:
            pass


class Orphans(Honest):
    """What it leaves behind goes on after it."""

    def act(self, observation):
        if os.fork() == 0:
            os.setsid()
            time.sleep(600.0)
        os._exit(0)


def main(place: str, name: str, *scenarios: str) -> None:
    from tsbench.episode.runner import EpisodeRunner
    from tsbench.planners.registry import resolve
    from tsbench.run.isolation.loading import describe, load
    from tsbench.run.log import score
    from tsbench.scenarios.table import read_table, table_path

    spec = f"{__file__}:{name}"
    runner = EpisodeRunner(resolve(spec) if place == "here" else load(describe(spec).planner))
    for row in read_table(table_path("dev")):
        if row.scenario_id in scenarios:
            result = runner.run(row)
            record = score.make_record(result, False)
            told = record.row
            ticks = result.facts.snapshots
            last = ticks[-1]
            told = (
                told["outcome"],
                told["scd"],
                len(ticks),
                last.ego.x,
                last.ego.y,
                len(last.actors),
                len(record.events),
            )
            print(json.dumps({"told": told, "error": result.error}))
    runner.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
