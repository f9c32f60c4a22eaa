"""Planners that cheat or attack. `HONEST` drives as they do where nothing comes of it.

python hostile.py PLACE SCENARIO NAME...: drives each here ("here") or in a sandbox ("sandbox"), and prints
what came of it as JSON. A name is one of this file, or FILE:NAME@SEED of another one beside it, which gets that seed.
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
from tsbench.scenarios.data_set import DataSet

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

        return [row.sign_code for row in DataSet().table("dev") if planner_seed(row.pair_name) == context.seed]


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

        from tsbench.episode import episode

        episode.advance = lambda motion, *_: replace(motion, x=motion.x + 0.5)


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

        from tsbench.run.log import record

        true = record.make_record
        record.make_record = lambda *a: replace(r := true(*a), row={**r.row, "scd": not r.row["scd"]})


class PatchesEnding(Honest):
    def attack(self, context):
        from tsbench.episode.outcome import Outcome, TerminationCheck

        TerminationCheck.at = lambda *_: Outcome.ARRIVED


class PatchesMonitors(Honest):
    def attack(self, context):
        from dataclasses import replace

        from tsbench.rules import monitors

        finish = monitors.Monitors.finish
        clean = lambda said: monitors.Verdicts(tuple(replace(one, violations=()) for one in said.targets))  # noqa: E731
        monitors.Monitors.finish = lambda self: clean(finish(self))


class Exits(Honest):
    def act(self, observation):
        os._exit(3)


class Crashes(Honest):
    def act(self, observation):
        ctypes.string_at(0)


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
        os.write(_line(), struct.pack("<I", 1 << 30))
        return super().act(observation)


class Counts(Honest):
    """A field that says it has more items than there are."""

    def act(self, observation):
        body = b"\x82\xa4kind\xa7control\xa6intent\xdd\xff\xff\xff\xff"
        os.write(_line(), struct.pack("<I", len(body)) + body)
        return super().act(observation)


class Twice(Honest):
    """An answer beside the answer, as for the next tick."""

    def act(self, observation):
        from tsbench.board.isolation.episode_messages import command_message

        os.write(_line(), 2 * command_message(Control(1.0, 0.0)))
        time.sleep(60.0)


class LongPlan(Honest):
    def act(self, observation):
        return Control(0.0, 0.0, plan=np.zeros((1_000_000, 2)))


class OddIntent(Honest):
    def act(self, observation):
        return Control(0.0, 0.0, intent=("nowhere",))


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


def strangers():
    """Processes other than this one, the one that it is a fork of, and the first of its namespace, bubblewrap's."""
    own = {str(os.getpid()), str(os.getppid()), "1"}
    return [one for one in Path("/proc").glob("[0-9]*") if one.name not in own]


class SeesProcesses(Honest):
    def attack(self, context):
        return strangers()


class KillsAll(Honest):
    def attack(self, context):
        os.kill(-1, signal.SIGKILL)


class StopsParent(Honest):
    def attack(self, context):
        # Bubblewrap's, which waits for all others: it cannot be stopped from within.
        with suppress(PermissionError):
            os.kill(1, signal.SIGSTOP)


class Ptraces(Honest):
    def attack(self, context):
        attach = 16
        return any(ctypes.CDLL(None).ptrace(attach, pid, 0, 0) == 0 for pid in range(1, 40_000))


class ReadsParent(Honest):
    """What stands in the environment of the referee, or of another process that is not the planner's."""

    def attack(self, context):
        found = []
        for one in strangers():
            with suppress(OSError):
                found.append((one / "environ").read_bytes())
        return found


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
        for folder in (ROOT / "tests", ROOT / "runs", ROOT / "tsbench", Path(sys.prefix), Path("/etc"), Path("/")):
            with suppress(OSError):
                (folder / "stray").write_text("mine")
                folder.joinpath("stray").unlink()
                return True
        return False


class Connects(Honest):
    def attack(self, context):
        with socket.create_connection(("127.0.0.1", int(Path(__file__).with_suffix(".port").read_text())), 1.0):
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


class SignalsParent(Honest):
    """Every signal to whoever may be the parent, by its number and by its group."""

    def attack(self, context):
        sent = []
        for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGKILL):
            for pid in {os.getppid(), *range(2, 300)} - {0, 1, os.getpid()}:
                with suppress(OSError):
                    os.kill(pid, number)
                    sent.append(pid)
        return sent


class FillsShm(Honest):
    """More than its share of the memory that files in memory take."""

    def attack(self, context):
        written = 0
        with suppress(OSError):
            for number in range(10):
                with Path(f"/dev/shm/{number}").open("wb") as file:
                    for _ in range(60):
                        written += file.write(bytes(1 << 20))
        return written > 300 << 20


class Hoards(Honest):
    """Memory that stays when it is mapped nowhere, where nobody's size shows it: files in no folder, System V's."""

    def attack(self, context):
        kept = []
        for number in range(4):
            with suppress(OSError):
                kept.append(os.memfd_create(str(number)))
        system = ctypes.CDLL(None)
        segment = system.shmget(0, 1 << 20, 0o1600)
        if segment != -1:
            kept.append(segment)
            # Else it would stay on this machine where nothing refuses it.
            system.shmctl(segment, 0, None)
        return kept


class Links(Honest):
    """Links where files of the run might be written."""

    def attack(self, context):
        made = []
        for folder in (ROOT / "runs", ROOT, Path(sys.prefix)):
            with suppress(OSError):
                (folder / "stray.link").symlink_to(ROOT / "tests")
                made.append(folder / "stray.link")
        for link in made:
            link.unlink()
        return made


class LinksAway(Honest):
    """Links where somebody else cleans up."""

    def attack(self, context):
        # Beside the folder for temporary files, where its own is in that.
        Path("away").symlink_to("../../../victim")
        Path("below").mkdir()
        Path("below/away").symlink_to("../../../../victim")


class Several(Honest):
    """One attack after the other, whatever came of those before; an error names what has won something."""

    def attack(self, context):
        names = []
        for kind in (
            OpensFiles, LiftsLimits, SeesProcesses, StopsParent, Ptraces, ReadsParent, Inherits, WritesRun, Links,
            LinksAway, Hoards, Connects, BecomesRoot, Uncovers, Environment,
        ):  # fmt: skip
            with suppress(Exception):
                names += [kind.__name__] if kind().attack(context) else []
        self.names = names

    def act(self, observation):
        assert not self.names, self.names
        return super().act(observation)


class Hangs(Honest):
    def act(self, observation):
        while True:
            time.sleep(1.0)


class Spins(Honest):
    def act(self, observation):
        while True:
            pass


class Drips(Honest):
    """An answer that never ends, byte by byte."""

    def act(self, observation):
        line = _line()
        os.write(line, struct.pack("<II", 1 << 20, 12))
        while True:
            os.write(line, b"\0")
            time.sleep(0.1)


class Gorges(Honest):
    """Far less than its limit, and more than the run allows a worker with all that it has started."""

    def act(self, observation):
        self.kept = np.ones(120_000_000)
        time.sleep(600.0)


class ChildGorges(Honest):
    def act(self, observation):
        for _ in range(2):
            if os.fork() == 0:
                kept = np.ones(60_000_000)
                time.sleep(600.0)
                os._exit(len(kept) > 0)
        time.sleep(600.0)


class Floods(Honest):
    """A hundred megabytes to the log."""

    def attack(self, context):
        for _ in range(100):
            os.write(2, b"z" * (1 << 20))


class Orphans(Honest):
    """What it leaves behind goes on after it."""

    def act(self, observation):
        if os.fork() == 0:
            os.setsid()
            time.sleep(600.0)
        os._exit(0)


def main(place: str, scenario: str, *names: str) -> None:
    """Beside the referee each name has a process of its own, so that no cheat meets another one's work."""
    import tsbench.episode.runner
    import tsbench.planners.registry
    import tsbench.run.log.record
    import tsbench.scenarios.data_set
    import tsbench.sim.sumo  # noqa: F401

    if place == "sandbox":
        drive(place, scenario, *names)
        return
    for name in names:
        if child := os.fork():
            os.waitpid(child, 0)
        else:
            drive(place, scenario, name)
            sys.stdout.flush()
            os._exit(0)


def drive(place: str, scenario: str, *names: str) -> None:
    from dataclasses import replace

    from tsbench.board.isolation.isolated_loading import load
    from tsbench.episode.runner import EpisodeRunner
    from tsbench.planners.registry import resolve
    from tsbench.run.log import record as log
    from tsbench.run.planner_info import PlannerInfo
    from tsbench.scenarios.scene_loader import SceneLoader
    from tsbench.sim.sumo import Simulation

    (row,) = [row for row in DataSet().table("dev") if row.scenario_id == scenario]
    simulation, loader = Simulation(), SceneLoader(DataSet())
    for name in names:
        spec, _, seed = name.partition("@")
        spec = f"{Path(__file__).parent}/{spec}" if ":" in spec else f"{__file__}:{spec}"
        loaded = resolve(spec) if place == "here" else load(PlannerInfo(name, spec, False, True, (), None, None))
        planner = Told(loaded.factory(), int(seed) if seed else None)
        loaded = replace(loaded, factory=lambda planner=planner: planner)
        result = EpisodeRunner(loaded, simulation=simulation, loader=loader).run(row)
        if place == "sandbox":
            planner.inner.close()
        record = log.make_record(result, False)
        told = record.row
        ticks = result.facts.snapshots
        last = ticks[-1]
        told = (told["outcome"], told["scd"], len(ticks), last.ego.x, last.ego.y, len(last.actors), len(record.events))
        print(json.dumps({"name": name, "told": told, "error": result.error}), flush=True)
    simulation.close()


class Told:
    """A planner that is told another seed than the scene's."""

    def __init__(self, inner, seed):
        self.inner, self.seed = inner, seed

    def reset(self, context):
        from dataclasses import replace

        self.inner.reset(context if self.seed is None else replace(context, seed=self.seed))

    def act(self, observation):
        return self.inner.act(observation)


if __name__ == "__main__":
    main(*sys.argv[1:])
