"""`tsbench doctor --arithmetic`: does this machine give the reference bytes for each planner that comes with tsbench?

Two things are looked at, each against hashes in `arithmetic.json`: what the networks answer to recorded questions
(`arithmetic.npz`), which must be equal on every CPU, and whole episodes, on which SUMO's and Python's mathematical
functions have a say too.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tsbench.cli.diagnosis import Diagnosis, Status
from tsbench.core.errors import InputError
from tsbench.core.files import write_json
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.base import Batched, Infer, Records
from tsbench.planners.registry import resolve
from tsbench.run.arithmetic import facts
from tsbench.run.log.record import make_record
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

RULES = ("idm", "idm-e")
# The networks, and who else drives by them.
NETWORKS = ("ppo", "carl", "plant2", "plant2-ft", "plant2-blind")
LEARNED = (*NETWORKS, "ppo-e", "carl-e", "plant2-e")
PLANNERS = (*RULES, *LEARNED)
_FOLDER = Path(__file__).parent
_REFERENCE, _ASKED = "arithmetic.json", "arithmetic.npz"
_KEPT = 4
_REMEDY = "docs/footguns.md says what this means"


def check_arithmetic(folder: Path = _FOLDER) -> Iterator[Diagnosis]:
    """What the arithmetic is, and for each planner whether it gives the reference's bytes."""
    data = DataSet()
    here = facts()
    yield Diagnosis(Status.OK, "numpy", f"{here['versions']['numpy']}, {' '.join(here['simd'])}")
    yield Diagnosis(Status.OK, "BLAS", here["blas"])
    yield Diagnosis(Status.OK, "libm", f"{here['libc']}, answers {here['answers']['libm']}")
    others = (f"{name} {number}" for name, number in here["versions"].items() if name != "numpy" and number)
    yield Diagnosis(Status.OK, "packages", ", ".join(others))
    reference = json.loads((folder / _REFERENCE).read_text(encoding="utf-8"))
    same_libm = here["answers"]["libm"] == reference["libm"]
    said = "as" if same_libm else "answers otherwise than"
    status, remedy = (Status.OK, "") if same_libm else (Status.NOTE, _REMEDY)
    yield Diagnosis(status, "libm", f"{said} where the reference was made", remedy)
    rows = {row.scenario_id: row for row in data.table("test")}
    sim, loader = Simulation(), SceneLoader(data)
    for name in PLANNERS:
        wanted, told = reference["planners"][name], list[str]()
        if "answers" in wanted and answers_hash(name, folder) != wanted["answers"]:
            told.append("its network's answers")
        for scenario, digest in wanted["episodes"].items():
            if scenario not in rows:
                raise InputError(f"{folder / _REFERENCE}: scenario {scenario} is not in the test split")
            if episode_hash(name, rows[scenario], sim, loader) != digest:
                told.append(f"episode {scenario}")
        if told:
            yield Diagnosis(Status.FAILED, name, f"differs: {', '.join(told)}", _REMEDY)
        else:
            asked = "network and " if "answers" in wanted else ""
            yield Diagnosis(Status.OK, name, f"{asked}{len(wanted['episodes'])} episodes as in the reference")
    sim.close()


def write_reference(folder: Path = _FOLDER) -> list[Path]:
    """Make this machine's bytes the reference; returns the files written."""
    # The first scene with traffic of each of a few types.
    rows = [row for row in DataSet().table("test") if row.density > 0]
    scenes = [next(row for row in rows if row.scenario_type == kind) for kind in ("yield", "no_turn_left")]
    sim, loader = Simulation(), SceneLoader(DataSet())
    asked = {name: _questions(name, scenes, sim, loader) for name in NETWORKS}
    plain = {name: np.frombuffer(records.tobytes(), dtype=np.uint8) for name, records in asked.items()}
    np.savez_compressed(folder / _ASKED, allow_pickle=False, **plain)
    planners: dict[str, Any] = {}
    for name in PLANNERS:
        planners[name] = {"answers": answers_hash(name, folder)} if name in NETWORKS else {}
        planners[name]["episodes"] = {s.scenario_id: episode_hash(name, s, sim, loader) for s in scenes}
    sim.close()
    content = {"libm": facts()["answers"]["libm"], "planners": planners}
    write_json(folder / _REFERENCE, content, indent=1)
    return [folder / _REFERENCE, folder / _ASKED]


def questions(name: str, folder: Path = _FOLDER) -> Records:
    with np.load(folder / _ASKED, allow_pickle=False) as stored:
        return np.frombuffer(stored[name].tobytes(), dtype=batched(name).inputs)


def answers_hash(name: str, folder: Path = _FOLDER) -> str:
    """SHA-256 (hex) of what a planner's own network answers to them."""
    answers = batched(name).network("cpu")(questions(name, folder))
    return hashlib.sha256(answers.tobytes()).hexdigest()


def episode_hash(name: str, spec: ScenarioSpec, sim: Simulation, loader: SceneLoader) -> str:
    """SHA-256 (hex) of an episode: commands, all places at each tick, and the record."""
    result = EpisodeRunner(resolve(name), simulation=sim, loader=loader).run(spec)
    if result.facts is None:
        raise InputError(f"{result.spec.scenario_id}: {result.planner} has not driven: {result.error}")
    digest = hashlib.sha256(result.commands.tobytes())
    for shot in result.facts.snapshots:
        ego = shot.ego
        digest.update(np.array([ego.x, ego.y, ego.heading, ego.speed]).tobytes() + shot.actors.pose.tobytes())
    digest.update(json.dumps(make_record(result, privileged=False).row, sort_keys=True).encode())
    return digest.hexdigest()


def _questions(name: str, scenes: list[ScenarioSpec], sim: Simulation, loader: SceneLoader) -> Records:
    """Some of what a planner asks its network in an episode, evenly over its time."""
    asked: list[Records] = []
    infer: Infer = batched(name).network("cpu")

    def listening(records: Records) -> Records:
        asked.append(records.copy())
        return infer(records)

    EpisodeRunner(resolve(name).answered_by(lambda: listening), simulation=sim, loader=loader).run(scenes[0])
    return np.concatenate(asked)[:: max(len(asked) // _KEPT, 1)][:_KEPT]


def batched(name: str) -> type[Batched]:
    """The class of a planner whose network is asked in batches."""
    planner = resolve(name).batched
    assert planner is not None
    return planner
