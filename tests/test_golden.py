"""Records, events and traces of some ninety episodes have the bytes that stand in golden.json.

A difference is a change of scoring: raise `SCORING` in tsbench/run/edition.py, then `make golden`. Where the machine's
arithmetic is not that of the file, verdicts are compared in place of bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from tsbench.core.provenance import DECIDING, versions
from tsbench.episode.perception_level import EXACTLY, Perception, load_level
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import write_trace
from tsbench.planners.registry import names, resolve
from tsbench.run import arithmetic
from tsbench.run.edition import SCORING
from tsbench.run.log.record import make_record
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec

GOLDEN = Path(__file__).with_name("golden.json")
# These share all types; every other planner drives a pair of one type.
TURNS = ("idm", "idm-e", "reader", "blind")
# Their code, or what it needs, comes from elsewhere.
ELSEWHERE = {"commonroad-reactive", "metadrive-ppo", "metadrive-ppo-e"}
IMPERFECT = ("reader", "poor")
# Tests, which share the episodes.
SHARES = 3
Task = tuple[str, str, list[ScenarioSpec]]


def pairs() -> list[list[ScenarioSpec]]:
    """The halves of the first pair of each type of dev, types in order."""
    found: dict[str, dict[str, list[ScenarioSpec]]] = {}
    for row in sorted(DataSet().table("dev"), key=lambda row: row.scenario_id):
        found.setdefault(row.pair_type, {}).setdefault(row.pair_id or row.scenario_id, []).append(row)
    return [next(iter(of_type.values())) for _, of_type in sorted(found.items())]


def tasks() -> Iterator[Task]:
    """(planner, perception level, rows)."""
    known = pairs()
    for number, rows in enumerate(known):
        yield TURNS[number % len(TURNS)], "exact", rows
    for number, name in enumerate(sorted({*names()} - {*TURNS} - ELSEWHERE)):
        yield name, "exact", known[(7 * number) % len(known)]
    for rows in known[::6]:
        yield *IMPERFECT, rows


def name_of(planner: str, level: str, row: ScenarioSpec) -> str:
    return f"{planner} {level} {row.scenario_id}"


def driven(asked: Iterable[Task]) -> dict[str, list[str]]:
    """Of each episode its verdict and the digest of its record, events and trace."""
    found = {}
    runners: dict[tuple[str, str], EpisodeRunner] = {}
    with TemporaryDirectory() as folder:
        trace = Path(folder, "trace.parquet")
        for name, level, rows in asked:
            if (name, level) not in runners:
                shared = next(iter(runners.values())).simulation if runners else None
                perception = EXACTLY if level == "exact" else Perception(level=load_level(level))
                runners[name, level] = EpisodeRunner(resolve(name), perception=perception, simulation=shared)
            for row in rows:
                result = runners[name, level].run(row)
                record = make_record(result, resolve(name).privileged)
                write_trace(trace, result)
                clauses = sorted({event["clause"] for event in record.events if event["target"]})
                verdict = " ".join([record.row["outcome"], str(record.row["scd"]), *clauses])
                digest = hashlib.sha256(repr((record.row, record.events)).encode() + trace.read_bytes())
                found[name_of(name, level, row)] = [verdict, digest.hexdigest()[:16]]
    return found


def machine() -> dict[str, object]:
    """What bytes depend on besides tsbench."""
    return {"versions": versions((*DECIDING, "pyarrow")), "answers": arithmetic.facts()["answers"]}


@pytest.fixture(scope="module")
def golden() -> dict[str, Any]:
    told: dict[str, Any] = json.loads(GOLDEN.read_text(encoding="utf-8"))
    return told


def test_all_episodes_stand_there_with_the_scoring_number(golden: dict[str, Any]) -> None:
    assert golden["scoring"] == SCORING, "make golden"
    assert golden["episodes"].keys() == {name_of(*of, row) for *of, rows in tasks() for row in rows}, "make golden"


@pytest.mark.timeout(300)
@pytest.mark.parametrize("share", range(SHARES))
def test_scoring_number_stands_for_these_bytes(golden: dict[str, Any], share: int) -> None:
    now, then = driven(islice(tasks(), share, None, SHARES)), golden["episodes"]
    compared = slice(None) if golden["machine"] == machine() else slice(1)
    differ = [name for name in now if now[name][compared] != then[name][compared]]
    assert not differ, "raise SCORING in tsbench/run/edition.py, then make golden"


if __name__ == "__main__":
    lines = (f"  {json.dumps(name)}: {json.dumps(told)}" for name, told in driven(tasks()).items())
    head = json.dumps({"scoring": SCORING, "machine": machine()}).removesuffix("}")
    GOLDEN.write_text(head + ', "episodes": {\n' + ",\n".join(lines) + "\n}}\n", encoding="utf-8")
