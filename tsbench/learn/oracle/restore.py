"""`tsbench oracle restore`: a collection from the tables that were chosen from it, for other experts to be added.

What is not in those tables is gone: commands of successes that do not count (experts without a network that were not
the fastest), and the stories of drives that broke off.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from itertools import groupby
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_json
from tsbench.learn.oracle.runner import FIGURES, pack
from tsbench.learn.oracle.store import beside, open_journal, read_collection, stream_tries
from tsbench.learn.oracle.trajectories import TrajectoryTable
from tsbench.run.log.manifest import NAME
from tsbench.run.log.quarantine import Quarantine
from tsbench.run.log.record import Record, Row

_TRY = ("attempt", "outcome", "error", "scd", *FIGURES)


def restore(table: Path, folder: Path) -> int:
    """Write the collection that `table` was chosen from into an empty folder; returns how many lines it has.

    Raises InputError: the folder is not empty; a table or the manifest is missing, broken or of another collection.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder}: is not empty; choose another folder")
    tries, told = beside(table)
    drives = TrajectoryTable(table)
    # All is looked at before anything is written.
    keys = [(row["planner"], row["scenario_id"]) for row in _lines(tries, drives, table)]
    if chosen := drives.keys() - set(keys):
        planner, scenario = min(chosen)
        raise InputError(f"{table}: {scenario}: {planner}: has no tries in {tries.name}")
    manifest = read_collection(told.parent, "tsbench oracle select writes its manifest", told.name)
    with io_errors_as_input_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        # Its table of tries is written by the next `collect`, from the journal.
        write_json(folder / NAME, {**manifest, "status": "interrupted"})
    journal = open_journal(folder, manifest["contract"], keys, Quarantine(folder), lambda _: True)
    with closing(journal):
        for row in _lines(tries, drives, table):
            journal.append(Record(row, [], {}, ""))
    return len(keys)


def _lines(tries: Path, drives: TrajectoryTable, table: Path) -> Iterator[Row]:
    for key, group in groupby(stream_tries(tries), lambda one: (one["planner"], one["scenario_id"])):
        many = list(group)
        last, drive = many[-1], drives.get(key)
        if drive is not None and (drive.attempt, drive.ego) != (last["attempt"], last["ego"]):
            raise InputError(f"{table}: {key[1]}: {key[0]}: its tries are of another collection")
        yield {
            "planner": key[0],
            "scenario_id": key[1],
            "outcome": last["outcome"],
            "error": last["error"],
            "scd": last["scd"],
            "tries": [{name: one[name] for name in _TRY} for one in many],
            "commands": None if drive is None else pack(drive.commands),
            "intents": None if drive is None else [[tick, list(edges)] for tick, edges in drive.intents],
            "scenario": last["scenario"],
            "code": last["code"],
        }
