"""The data card of exported ticks: README.md in their folder, NAME.README.md beside a file."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import tsbench
from tsbench.core.parquet import OSM_LICENCE
from tsbench.learn.envs.scene_seen import EGO, SceneSeen
from tsbench.learn.oracle.ticks import REWARDS, Driven, shapes
from tsbench.sim.world import DT_S

NAME = "README.md"
_SEEN = {
    "state": f"the ego: {', '.join(EGO)}",
    "route": "points of the navigation's way ahead, in the ego's frame",
    "plates": "plates in sight: place, value, whose lane each is for, one-hot code; the last column is a post whose "
    "plate is not known",
    "plates_mask": "1 where a row of `plates` is one",
    "lanes": "polylines of lanes and of ways through junctions around the ego, with what they are",
    "lanes_mask": "1 where a row of `lanes` is one",
    "actors": "road users in sight: place, heading, speed, size, kind",
    "actors_mask": "1 where a row of `actors` is one",
    "obstacles": "obstacles in sight: place, heading, size",
    "obstacles_mask": "1 where a row of `obstacles` is one",
}
_REWARDS = {
    "progress": "share of the way that the tick brought, times soft penalties",
    "violation": "minus the number of violations that began in the tick",
    "needless": "minus the number of acts of needless obedience that began in the tick",
    "end": "-1 at a collision, beside the road and out of time, else 0",
}


class Card:
    """Counts drives as they are exported, and says what they are."""

    def __init__(self, seen: SceneSeen) -> None:
        self._seen = seen
        self._drives = self._ticks = 0
        self._of: dict[str, Counter[str]] = {name: Counter() for name in ("type", "half", "planner", "part")}

    def add(self, drive: Driven) -> None:
        self._drives += 1
        self._ticks += len(drive.ticks)
        for name, counter in self._of.items():
            counter[drive.facts[name]] += 1

    def text(self, table: Path, split: str, rank: int, limit: int | None) -> str:
        """Markdown. table: whose drives they are; the others as they were asked of `export`."""
        sha256 = hashlib.sha256(table.read_bytes()).hexdigest()
        best = f"up to rank {rank}" if rank else "of all ranks"
        few = "" if limit is None else f" --limit {limit}"
        hours = self._ticks * DT_S / 3600.0
        lines = [
            "---", "license: odbl", "task_categories: [robotics, reinforcement-learning]",
            "tags: [autonomous-driving, traffic-signs, imitation-learning]", "---", "",
            "# Drives of tsbench's oracle, tick by tick", "",
            f"{self._drives} drives {best} of the split `{split}`: {self._ticks} ticks of {DT_S:g} s ({hours:.2f} h). "
            f"Each drive obeyed the sign and arrived.", "",
            "Experts drove that are told the rule of the sign. They see others and plates without error. Scenes are "
            "simulated (SUMO) on real roads. There are no camera pictures.", "",
            f"Of `{table.name}` (SHA-256 `{sha256}`), by tsbench {tsbench.__version__}:", "",
            "```", f"tsbench oracle export --split {split} --rank {rank}{few}", "```", "",
            f"Licence: {OSM_LICENCE['licence']}.", "",
            "## What a tick holds", "",
            "Numbers of `observation` are scaled to -1..1.",
            "",
            *_table(("name", "shape", "what"), self._columns()), "",
            "The columns of the one-hot code, in order: "
            f"{', '.join(f'`{code}`' for code in self._seen.codes[:-1])}, not known.", "",
            "## What is in it", "",
            *_table(("", "drives"), self._counts()), "",
        ]  # fmt: skip
        return "\n".join(lines)

    def _columns(self) -> Iterable[tuple[str, str, str]]:
        of = shapes(self._seen)
        for name, what in _SEEN.items():
            shape = of[f"observation.{name}"]
            yield f"`observation.{name}`", " x ".join(map(str, shape)), what
        yield ("`action`", "2", "acceleration (m/s²) and steering (rad, left positive) that were driven in the tick")
        for name in REWARDS:
            yield f"`reward.{name}`", "1", _REWARDS[name]
        yield "`timestamp`, `done`", "1", "s since the episode began; the drive's last tick"
        yield ("`scenario_id`, `planner`, `part`", "1", "which drive, whose, and whether for training or validation")
        yield ("`type`, `sign`, `half`", "1", "of the scene: its type, its sign's code, and which half of a pair")

    def _counts(self) -> Iterable[tuple[str, str]]:
        for name, counter in self._of.items():
            for value, count in sorted(counter.items()):
                yield f"{name} `{value}`", str(count)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    first, *rest = (f"| {' | '.join(row)} |" for row in (head, *rows))
    return [first, f"|{'---|' * len(head)}", *rest]
