"""Traces of a run's episodes: those that it kept, and those of episodes that are driven again."""

from __future__ import annotations

from functools import cached_property, lru_cache
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.parquet import with_text
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, read_trace, trace_path, write_trace
from tsbench.run.edition import contract_hash, standing_contract
from tsbench.run.log.manifest import planners_of
from tsbench.run.log.read import StoredRun, read_run
from tsbench.run.log.record import Row, make_record, same_value
from tsbench.run.planner_info import resolve_unchanged
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

_ALL = "tsbench run --trace all keeps all traces"


class Traces:
    """Traces of one run. An episode without one is driven again in this process, and has one in the run's folder then.

    Episodes are deterministic: one that is driven again has the record that the run has of it, or it is refused.
    """

    def __init__(self, run: StoredRun) -> None:
        self.run, self.loader = run, SceneLoader(run.data)
        self._runners: dict[str, EpisodeRunner] = {}

    def read(self, planner: str, scenario_id: str) -> Trace:
        """The trace of an episode. Raises InputError where it has none and cannot be driven again as it was."""
        path = trace_path(self.run.path, planner, scenario_id)
        if not path.is_file():
            name = f"{self.run.path}: {planner}/{scenario_id}"
            if why := self._why_not(planner):
                raise InputError(f"{name} has no trace and cannot be driven again: {why}")
            self._drive(name, self.run.row(f"{planner}/{scenario_id}"), path)
        return read_trace(path)

    def of_other_half(self, row: Row) -> Trace | None:
        """The trace of the other half of a record's pair.

        None where the run has no such episode, and where that has no trace and the planner cannot drive again.
        """
        if not row["pair_id"]:
            return None
        halves = with_text(self.run.of(row["planner"]), "pair_id", row["pair_id"]).to_pylist()
        other = next((half for half in halves if half["half"] != row["half"]), None)
        if other is None:
            return None
        key = other["planner"], other["scenario_id"]
        there = trace_path(self.run.path, *key).is_file() or not self._why_not(row["planner"])
        return self.read(*key) if there else None

    @cached_property
    def _split(self) -> dict[str, ScenarioSpec] | None:
        """The rows of the run's split by scenario; None where this tsbench has another contract for it."""
        data = self.run.data
        rows = data.table(self.run.manifest["effective"]["split"])
        if standing_contract(contract_hash(rows, data.catalog)) != self.run.contract:
            return None
        return {row.scenario_id: row for row in rows}

    @cached_property
    def _simulation(self) -> Simulation:
        return Simulation()

    def _why_not(self, planner: str) -> str:
        """Why no episode of a planner can be driven again; "" where they can."""
        manifest = self.run.manifest
        if "isolation" in manifest:
            return f"planners were isolated ({_ALL})"
        if self._split is None:
            return f"the run has another contract than this tsbench ({_ALL})"
        if planner not in self._runners:
            info = next(info for info in planners_of(manifest) if info.name == planner)
            try:
                loaded = resolve_unchanged(info).on(manifest["effective"].get("device", "cpu"))
            except InputError as problem:
                return str(problem)
            self._runners[planner] = EpisodeRunner(
                loaded, perception=self.run.perception, simulation=self._simulation, loader=self.loader
            )
        return ""

    def _drive(self, name: str, old: Row, path: Path) -> None:
        assert self._split is not None
        result = self._runners[old["planner"]].run(self._split[old["scenario_id"]])
        new = make_record(result, old["privileged"]).row
        for column, value in old.items():
            if not same_value(value, new[column]):
                raise InputError(
                    f"{name}: is another episode when it is driven again: {column} was {value!r}, now {new[column]!r}. "
                    "Make the planner deterministic, or keep all traces (tsbench run --trace all)"
                )
        if result.facts is None or not result.facts.snapshots:
            raise InputError(f"{name}: ended before its first tick: {result.error}")
        write_trace(path, result)


@lru_cache(maxsize=1)
def traces_of(run: Path) -> Traces:
    """Traces of the run folder that this process works on; it may be under way."""
    return Traces(read_run(run, under_way=True))
