"""Take over what a new edition leaves as it is: rows of a complete run whose scene, rules and scoring are the same.

python packaging/carry_rows.py results/dev        then `tsbench campaign` drives the others into the folder

The rows are compared with those of the commit that the run names: each has the contract of a table with it alone. The
run stays under the planners and options that it has; `sessions` of its `run.json` says how many rows it took over from
which commit.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.files import write_json
from tsbench.core.parquet import dicts_of
from tsbench.run.arithmetic import differences, facts
from tsbench.run.edition import LOCAL, contract_hash, edition_here
from tsbench.run.log.folder import RunFolder
from tsbench.run.log.journal import read_table
from tsbench.run.log.manifest import NAME, city_of, new_manifest, planners_of, timestamp
from tsbench.run.log.read import EPISODES, read_run
from tsbench.run.log.record import TABLES, Record
from tsbench.run.options import RunOptions, options_in
from tsbench.run.plan import make_plan
from tsbench.scenarios.data_set import DataSet

ROOT = Path(__file__).resolve().parent.parent
_READ = ("tsbench", "sign_catalog", "scenarios/*.parquet", "cities/*.parquet", "cities/*.yaml")
# Among names of rows that of their whole table.
_WHOLE = ""


def carry(folder: Path) -> tuple[int, int]:
    """Turn a complete run into one that is interrupted before the rows that differ.

    Returns how many episodes it has taken over, and of how many.
    Raises InputError for a run that is not complete, has errors, or was driven with another arithmetic, or on what its
    commit does not have.
    """
    run = read_run(folder)
    commit, split = run.manifest["git"]["commit"], run.manifest["effective"]["split"]
    if run.manifest["status"] != "complete" or run.manifest["counts"]["errors"]:
        raise InputError(f"{folder}: is not complete, or has errors")
    before, now = _digests_at(commit, city_of(run.manifest), split), digests(city_of(run.manifest), split)
    if run.manifest["edition"].endswith(LOCAL) or before[_WHOLE] != run.manifest["contract"]:
        raise InputError(f"{folder}: was driven by code or on scenes that commit {commit} does not have")
    device, specs = run.manifest["effective"]["device"], [planner.spec for planner in planners_of(run.manifest)]
    if other := differences(run.manifest.get("arithmetic"), facts(), specs, device):
        raise InputError(f"{folder}: {other[0]}: its rows and new ones would be of two machines")
    same = {row for row, digest in now.items() if before.get(row) == digest}

    known = {name: run.manifest["asked"][name] for name in options_in(RunOptions) if name in run.manifest["asked"]}
    known |= {name: tuple(known[name]) for name in ("planners", "types")}
    options = RunOptions(**{**known, "city": city_of(run.manifest), "out": folder, "workers": None})
    data = DataSet.named(options.city)
    plan = make_plan(options, data)
    contract, told = now[_WHOLE], options.resolved(plan.types, len(plan.scenarios), options.perceived())
    planners = planners_of(run.manifest)
    manifest = new_manifest(contract, run.manifest["asked"], told, planners, edition_here(contract, data))
    keys = [(planner.name, row.scenario_id) for planner in planners for row in plan.scenarios]
    tables = {name: _by_episode(read_table(folder / name)) for name in TABLES}
    kept = [key for key in keys if key[1] in same and key in tables[EPISODES]]
    with closing(RunFolder(folder, manifest, keys, overwrite=True)) as new:
        for key in kept:
            row, timing = (tables[name][key][0] for name in (EPISODES, "timing.parquet"))
            new.keep(Record(row, tables["violations.parquet"].get(key, []), timing, ""))
        new.manifest["sessions"] = [*run.manifest["sessions"], {**new.manifest["sessions"][0], "carried_from": commit}]
        new.manifest["sessions"][-1].update(finished=timestamp(), status="interrupted", episodes=len(kept))
        new.manifest["status"] = "interrupted"
        write_json(folder / NAME, new.manifest)
    return len(kept), len(keys)


def digests(city: str, split: str) -> dict[str, str]:
    """By scenario the contract of a table that has its row alone, and that of the whole table."""
    data = DataSet.named(city)
    rows = data.table(split)
    alone = {row.scenario_id: contract_hash([row], data.catalog) for row in rows}
    return {_WHOLE: contract_hash(sorted(rows, key=lambda row: row.scenario_id), data.catalog), **alone}


def _digests_at(commit: str, city: str, split: str) -> dict[str, str]:
    """The same, by the code and data of a commit."""
    with tempfile.TemporaryDirectory() as place:
        command = ["git", "-C", str(ROOT), "archive", commit, "--", *_READ]
        with tarfile.open(fileobj=BytesIO(subprocess.run(command, check=True, capture_output=True).stdout)) as found:
            found.extractall(place, filter="data")
        asked = [sys.executable, "-P", str(Path(__file__).resolve()), "--digests", city, split]
        told = subprocess.run(asked, check=True, capture_output=True, env={**os.environ, "PYTHONPATH": place})
    found_digests: dict[str, str] = json.loads(told.stdout)
    return found_digests


def _by_episode(table: pa.Table) -> dict[tuple[str, str], list[dict[str, object]]]:
    found: dict[tuple[str, str], list[dict[str, object]]] = {}
    for row in dicts_of(table):
        found.setdefault((row["planner"], row["scenario_id"]), []).append(row)
    return found


if __name__ == "__main__":
    if sys.argv[1] == "--digests":
        print(json.dumps(digests(*sys.argv[2:])))
    else:
        for place in sys.argv[1:]:
            print("{}: {} of {} episodes carried".format(place, *carry(Path(place))))
