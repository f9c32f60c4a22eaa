"""A run folder as others read it: manifest and records, checked against each other.

Beside them `rescored.json`: that the run was judged again, what of it, by what, and how that ended.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import pyarrow as pa

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_json
from tsbench.core.parquet import dicts_of, with_text
from tsbench.core.typed import read_typed
from tsbench.episode.perception_level import Perception
from tsbench.run.edition import edition_here, edition_of, standing_contract
from tsbench.run.log.journal import JOURNAL, file_hashes, lines_so_far, read_table, tables_of
from tsbench.run.log.manifest import NAME, Manifest, city_of, perception_of, planners_of, read_manifest
from tsbench.scenarios.data_set import DataSet

RESCORED = "rescored.json"
_VERSION: Literal[1] = 1
# What was judged; wall-clock figures are no verdicts.
_JUDGED = ("episodes.parquet", "violations.parquet")


@dataclass(frozen=True)
class Rescored:
    """judged: SHA-256 (hex) of the tables. contract, edition, tsbench: of the judge. traces: judged again.

    untraced: episodes without a readable trace. disagreements: values that came out differently.
    """

    judged: Mapping[str, str]
    contract: str
    edition: str
    tsbench: str
    traces: int
    untraced: int
    disagreements: int
    schema_version: Literal[1] = _VERSION


def write_rescored(folder: Path, data: DataSet, contract: str, traces: int, untraced: int, disagreements: int) -> None:
    """Write down how judging a run again ended. Raises InputError where the folder takes nothing."""
    hashes = file_hashes(folder)
    judged, edition = {name: hashes[name] for name in _JUDGED}, edition_here(contract, data)
    told = Rescored(judged, contract, edition, tsbench.__version__, traces, untraced, disagreements)
    with io_errors_as_input_errors(folder):
        write_json(folder / RESCORED, {"schema_version": _VERSION, **asdict(told)})


def read_rescored(folder: Path) -> Rescored | None:
    """What `write_rescored` wrote, None where it wrote nothing. Raises InputError for anything else."""
    path = folder / RESCORED
    if not path.exists():
        return None
    try:
        return read_typed(Rescored, path, "record of a second judgement")
    except InputError as problem:
        raise InputError(f"{problem}: tsbench rescore writes it again") from None


def tell_rescored(folder: Path, contract: str, files: Mapping[str, str] | None) -> str:
    """One line: was a run judged again, and with what result? contract, files: of the run, as its manifest has them."""
    found = read_rescored(folder)
    if found is None:
        return "not rescored"
    if any((files or {}).get(name) != found.judged.get(name) for name in _JUDGED):
        return "rescored before its tables were changed: what stands in them was not judged again"
    total = found.traces + found.untraced
    agrees = f"{found.disagreements} disagreements" if found.disagreements else "all agree"
    other = "" if standing_contract(found.contract) == contract else f", under another contract ({found.contract[:12]})"
    return f"rescored with edition {found.edition}{other}: {found.traces} of {total} episodes by their traces, {agrees}"


EPISODES = "episodes.parquet"
_ENDED = ("complete", "interrupted")
_OF_STORIES = ["planner", "scenario_id", "clause", "value", "threshold", "unit", "sentence"]


@dataclass(frozen=True)
class StoredRun:
    """A run. asked: scenarios asked of each planner, by its name in the records, in the order of the command.

    events: of a run that is under way its violations so far; None: the run's table has them.
    """

    path: Path
    manifest: Manifest
    episodes: pa.Table
    asked: dict[str, int]
    events: pa.Table | None = None

    @cached_property
    def violations(self) -> pa.Table:
        """Each event. Raises InputError where the table cannot be read."""
        return read_table(self.path / "violations.parquet") if self.events is None else self.events

    @cached_property
    def stories(self) -> dict[tuple[str, str], dict[str, Any]]:
        """By planner and scenario: the event of its `violation_clause`, the first that counts against SCD."""
        rows = dicts_of(self.episodes.select(["planner", "scenario_id", "violation_clause"]))
        clauses = {(row["planner"], row["scenario_id"]): row["violation_clause"] for row in rows}
        found: dict[tuple[str, str], dict[str, Any]] = {}
        for event in dicts_of(self.violations.filter(self.violations["target"]).select(_OF_STORIES)):
            key = event["planner"], event["scenario_id"]
            if event["clause"] == clauses.get(key):
                found.setdefault(key, event)
        return found

    @cached_property
    def contract(self) -> str:
        """The contract that its results are compared under (`edition.standing_contract`)."""
        return standing_contract(str(self.manifest["contract"]))

    @property
    def data(self) -> DataSet:
        """What it was driven on."""
        return DataSet.named(city_of(self.manifest))

    @property
    def edition(self) -> str:
        return edition_of(self.contract, self.manifest.get("edition"), self.data)

    @property
    def perception(self) -> Perception:
        """How plates reached its planners."""
        return perception_of(self.manifest)

    @property
    def rescored(self) -> str:
        return tell_rescored(self.path, self.contract, self.manifest["files"])

    def of(self, planner: str) -> pa.Table:
        return with_text(self.episodes, "planner", planner)

    def row(self, episode: str) -> dict[str, Any]:
        """The record of `scenario_id` or `planner/scenario_id`.

        Raises InputError for no such episode, naming a few, and for a scenario of several planners.
        """
        planner, _, scenario_id = episode.rpartition("/")
        rows = self.of(planner) if planner else self.episodes
        found = with_text(rows, "scenario_id", scenario_id).to_pylist()
        if len(found) > 1:
            choices = ", ".join(_names(found))
            raise InputError(f"{self.path}: {episode} was driven by several planners, name one: {choices}")
        if not found:
            names = _names(self.episodes.slice(0, 3).to_pylist())
            some = f"there are {', '.join(names)}, …" if names else "it has none yet"
            raise InputError(f"{self.path}: no episode {episode!r}; {some}")
        row: dict[str, Any] = found[0]
        return row

    def holes(self, planner: str) -> int:
        """Scenarios asked of a planner that have no record."""
        return self.asked[planner] - len(self.of(planner))


def _names(rows: Iterable[Mapping[str, Any]]) -> list[str]:
    return [f"{row['planner']}/{row['scenario_id']}" for row in rows]


def is_run(path: Path) -> bool:
    return (path / NAME).is_file()


def read_run(path: Path, *, under_way: bool = False) -> StoredRun:
    """Read a run. Raises InputError: no run, another schema version, torn or exchanged tables.

    under_way: one that is being driven, or was killed, has the episodes that its journal has.
    """
    manifest = read_manifest(path)
    if manifest is None:
        raise InputError(f"{path}: no run folder (it has no {NAME})")
    if "scenarios" not in manifest["effective"]:
        raise InputError(f"{path / NAME}: not the manifest of a tsbench run, but of a collection")
    asked = dict.fromkeys((p.name for p in planners_of(manifest)), manifest["effective"]["scenarios"])
    status, recorded = manifest["status"], manifest["files"] or {}
    if under_way and status not in _ENDED and (path / JOURNAL).is_file():
        tables = tables_of(lines_so_far(path / JOURNAL))
        return StoredRun(path, manifest, tables[EPISODES], asked, tables["violations.parquet"])
    episodes = read_table(path / EPISODES)
    # While a session is under way the tables of the one before may already have been replaced.
    if status in _ENDED:
        for name, digest in file_hashes(path).items():
            if recorded.get(name) != digest:
                raise InputError(f"{path / name}: is not the file that the run wrote (SHA-256 differs)")
    return StoredRun(path, manifest, episodes, asked)
