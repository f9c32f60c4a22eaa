"""A collection on disk: what each expert did on each scenario, kept as it comes.

DIR/run.json        what it was made with; experts and scenarios may be added later
DIR/journal.jsonl   a checked line for each expert and scenario: all tries, the commands of the success
DIR/tries.parquet   one row per try, the same bytes whatever the workers, the order or the interruptions
DIR/errors/         stories of drives that broke off
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic, write_json
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, columns, open_table, save_table
from tsbench.core.provenance import digest, versions
from tsbench.learn.oracle.trajectories import FIGURES, ORIGIN, Commands, Intents, lost_try, unpack
from tsbench.run.log.folder import write_error
from tsbench.run.log.journal import Content, Journal, Key, Quarantine, decode
from tsbench.run.log.manifest import NAME, Manifest, difference, plain_planners, planners_of, read_manifest, timestamp
from tsbench.run.log.record import Record, Row
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.world import DT_S

KIND = "oracle"
RULES, LEARNED = "rules", "learned"
_JOURNAL, _TRIES = "journal.jsonl", "tries.parquet"
_PARTS = {"row", "events", "timing", "trace"}
_ROW = {"planner", "scenario_id", "outcome", "error", "scd", "tries", "commands", "intents", "scenario", "code"}
_OUTDATED = "of a scenario or an expert that has changed"


SCHEMA = pa.schema(
    [
        *columns(pa.string(), "planner", "kind", "scenario_id", "scenario_type", "group", "map_id"),
        *columns(pa.int16(), "attempt"),
        *columns(pa.string(), "outcome"),
        *columns(pa.string(), "error", nullable=True),
        *columns(pa.bool_(), "scd"),
        *columns(pa.bool_(), "compliant", "engaged", nullable=True),
        *columns(pa.int32(), "steps", nullable=True),
        *columns(pa.float64(), "duration_s", "comfort", "mean_speed", nullable=True),
        *columns(pa.string(), "ego", "others", nullable=True),
        *columns(pa.string(), "scenario", "code"),
    ]
).with_metadata({VERSION_KEY: "1", **OSM_LICENCE})


@cache
def fingerprint(spec: ScenarioSpec) -> str:
    """12 hex digits over a scenario row."""
    return digest(asdict(spec))[:12]


def basis(data: DataSet) -> str:
    """SHA-256 (hex) over what all drives of a collection share: the rules of all signs, and SUMO's version.

    Not the code that made them: a drive is its commands, and replaying them proves it (`tsbench oracle verify`).
    """
    return digest({"signs": data.catalog.contract_entries(data.catalog.signs), "versions": versions(["libsumo"])})


class Collection:
    """A folder that this process collects into; to be closed.

    notices: lines about what was found there and is not trusted; it is set aside.
    """

    def __init__(
        self,
        path: Path,
        manifest: Manifest,
        table: Sequence[ScenarioSpec],
        planners: Sequence[PlannerInfo],
        redrive: bool = False,
    ) -> None:
        """Open or continue `path`. table: all rows of the split. planners: those that are asked for now.

        redrive: what other code of these has driven is driven again. What other weights have driven always is.

        Raises InputError: the folder holds something else, is in use, or cannot be written.
        """
        self.path = path
        self._rows = {spec.scenario_id: spec for spec in table}
        self._codes = {p.name: _code(p) for p in planners}
        self._redrive = redrive
        self._by_other_code: Counter[str] = Counter()
        aside = Quarantine(path)
        with io_errors_as_input_errors(path):
            path.mkdir(parents=True, exist_ok=True)
            old = check_folder(path, manifest)
            known = {} if old is None else {p.name: p for p in planners_of(old)}
            self._retrained = {
                p.name for p in planners if p.name in known and known[p.name].weights_sha256 != p.weights_sha256
            }
            self._planners = known | {p.name: p for p in planners}
            self.manifest = manifest if old is None else {**old, "versions": manifest["versions"]}
            self._save("running", finished=None)
        keys = [(name, scenario) for name in self._planners for scenario in self._rows]
        basis_ = f"{KIND} {manifest['contract']}"
        self.journal = Journal(path / _JOURNAL, keys, basis_, aside, self._sound, _whole, _OUTDATED)
        self.notices = [
            *aside.notices(),
            *(
                f"{path}: {count} lines were driven by other code of {name}: tsbench oracle verify proves them, "
                "--redrive drives them again"
                for name, count in sorted(self._by_other_code.items())
                if count
            ),
        ]

    def keep(self, record: Record) -> Row:
        row = record.row
        if "tries" not in row:
            row = {name: row[name] for name in ("planner", "scenario_id", "outcome", "error", "scd")}
            row |= {"tries": [lost_try(row["outcome"], row["error"])], "commands": None, "intents": None}
        row = {**row, "scenario": fingerprint(self._rows[row["scenario_id"]]), "code": self._codes[row["planner"]]}
        if record.detail:
            write_error(self.path, record)
        self.journal.append(Record(row, [], {}, ""))
        return row

    def end(self, complete: bool) -> None:
        """Write the table of tries, and how it ended."""
        table: dict[str, list[Any]] = {name: [] for name in SCHEMA.names}
        for key in sorted(self.journal.done):
            for line in self._lines(key):
                for name, column in table.items():
                    column.append(line[name])
        with io_errors_as_input_errors(self.path):
            save_table(pa.table(table, schema=SCHEMA), self.path / _TRIES)
            self._save("complete" if complete else "interrupted", finished=timestamp())

    def close(self) -> None:
        self.journal.close()

    def _lines(self, key: Key) -> Iterator[Row]:
        row = self.journal.read(key)["row"]
        spec = self._rows[row["scenario_id"]]
        head = {name: getattr(spec, name) for name in ("scenario_id", "scenario_type", "group", "map_id")}
        head |= {"planner": row["planner"], "kind": LEARNED if self._planners[row["planner"]].weights_sha256 else RULES}
        for one in row["tries"]:
            seconds = None if one["steps"] is None else round(one["steps"] * DT_S, 6)
            yield {**head, **one, "duration_s": seconds, "scenario": row["scenario"], "code": row["code"]}

    def _save(self, status: str, finished: str | None) -> None:
        planners = plain_planners([self._planners[name] for name in sorted(self._planners)])
        self.manifest = {**self.manifest, "planners": planners, "status": status, "finished": finished}
        write_json(self.path / NAME, self.manifest)

    def _sound(self, content: Content) -> bool:
        """Is it of the scenario as it stands, and of the expert with the weights that it has now?"""
        row = content["row"]
        name = row["planner"]
        other = self._codes.get(name, row["code"]) != row["code"]
        if other and (self._redrive or name in self._retrained):
            return False
        sound = bool(row["scenario"] == fingerprint(self._rows[row["scenario_id"]]))
        self._by_other_code[name] += sound and other
        return sound


def check_folder(path: Path, new: Mapping[str, Any]) -> Manifest | None:
    """The manifest of a collection that may be continued, or None. Raises InputError for another thing.

    new: `contract` and `effective` of the collection that is wanted; experts may differ.
    """
    old = read_manifest(path)
    if old is None:
        if path.is_dir() and any(path.iterdir()):
            raise InputError(f"{path}: is neither empty nor a collection; choose another with --out")
        return None
    differs = difference(old, {"contract": new["contract"], "effective": new["effective"]})
    if differs is not None:
        raise InputError(f"{path}: holds another collection: {differs}; choose another folder with --out")
    return old


def read_collection(folder: Path) -> Manifest:
    """The manifest of a collection. Raises InputError without one."""
    manifest = read_manifest(folder)
    if manifest is None or manifest["effective"].get("collection") != KIND:
        raise InputError(f"{folder / NAME}: no collection (tsbench oracle collect makes one)")
    return manifest


def read_tries(path: Path) -> list[Row]:
    """Rows of a table of tries: its file, or the folder of a collection. Raises InputError for another table."""
    file, hint = (path / _TRIES, "tsbench oracle collect makes it") if path.is_dir() else (path, ORIGIN)
    rows: list[Row] = open_table(file, SCHEMA, hint).to_pylist()
    return rows


def copy_beside(folder: Path, table: Path) -> None:
    """Put the tries and the manifest of a collection beside the table that was chosen from it."""
    places = table.with_name(f"{table.stem}_tries.parquet"), table.with_suffix(".json")
    for name, path in zip((_TRIES, NAME), places, strict=True):
        with io_errors_as_input_errors(path):
            write_atomic(path, (folder / name).read_bytes())


def read_drives(folder: Path, wanted: set[Key]) -> Iterator[tuple[Key, Commands, Intents]]:
    """The successful drives of chosen experts and scenarios, in the journal's order."""
    path = folder / _JOURNAL
    with io_errors_as_input_errors(path), path.open("rb") as file:
        for line in file:
            row = (decode(line) or {}).get("row")
            if row is None or (row["planner"], row["scenario_id"]) not in wanted or row["commands"] is None:
                continue
            intents = tuple((tick, tuple(edges)) for tick, edges in row["intents"])
            yield (row["planner"], row["scenario_id"]), unpack(row["commands"]), intents


def _code(planner: PlannerInfo) -> str:
    both = f"{planner.code_sha256} {planner.weights_sha256}"
    return hashlib.sha256(both.encode()).hexdigest()[:12]


def _whole(content: Any) -> bool:
    if not isinstance(content, dict) or set(content) != _PARTS or not isinstance(content["row"], dict):
        return False
    row = content["row"]
    wanted = {"attempt", "outcome", "error", "scd", *FIGURES}
    return set(row) == _ROW and all(isinstance(t, dict) and set(t) == wanted for t in row["tries"])
