"""`make edition SAME_AS=<contract>`: changed code keeps its edition where a sample of episodes has the same bytes.

The state of the repository that has the contract is checked out beside this one. Scenes, signs and versions of packages
must be equal; both states then drive the sample, and every record, event and trace must be equal. Only then does
`editions.yaml` get the new contracts, with the old ones under `same` (docs/editions.md).
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import pyarrow.parquet as pq
import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.machine import own_cores
from tsbench.core.paths import OWN_CITY, using_city
from tsbench.run.contract import contract_hash
from tsbench.run.edition import PATH, SameResults, release_all
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog

ROOT = Path(tsbench.__file__).resolve().parents[1]
# Two pairs of each type.
_SPLIT, _ROWS_OF_TYPE = "dev", 4
# Data of another place than the state's own.
_ELSEWHERE = ("TSBENCH_DATA", "TSBENCH_CITY")
# Timing differs from drive to drive.
_TABLES = ("episodes.parquet", "violations.parquet")
_TSBENCH = "from tsbench.cli import main; main()"
# Prints the hash of a state's code and its contracts by city and split.
_STATE = """
import json
from tsbench.core.paths import OWN_CITY, using_city
from tsbench.run.contract import code_hash
from tsbench.run.edition import contract_now, earlier_splits, shipped_titles
from tsbench.scenarios.table import splits_there
own = {split: contract_now(split) for split in splits_there() if split not in earlier_splits()}
found = {OWN_CITY: own}
for city in shipped_titles():
    with using_city(city):
        found[city] = {split: contract_now(split) for split in splits_there()}
print(json.dumps([code_hash(), found]))
"""
_NAMES = "from tsbench.planners.registry import names; print(*names())"


@dataclass(frozen=True)
class SameBytes:
    """What two states drove with the same bytes. digest: SHA-256 (hex) of the records and traces of either.

    codes: of the planners whose code differs, its SHA-256 (hex) in the earlier state and in this one.
    """

    planners: tuple[str, ...]
    episodes: int
    digest: str
    codes: Mapping[str, tuple[str, str]]

    def __str__(self) -> str:
        return (
            f"{self.episodes} episodes of {_SPLIT} by {', '.join(self.planners)}: equal records, events and traces, "
            f"SHA-256 {self.digest}"
        )


def commits_of(contract: str, root: Path = ROOT) -> Iterator[str]:
    """Commits whose `editions.yaml` has released `contract`, any split's, newest first.

    Only commits that change code, signs or scenes are named: others have the contract of the one before.
    """
    path = PATH.resolve().relative_to(ROOT).as_posix()
    for commit in _git(root, "log", "--format=%H", "--", "tsbench", "sign_catalog", "scenarios").split():
        text = _git(root, "show", f"{commit}:{path}", optional=True)
        if text and contract in list(yaml.safe_load(text)[-1]["released"].values())[-1].values():
            yield commit


@contextmanager
def checked_out(commit: str, root: Path = ROOT) -> Iterator[Path]:
    """A folder with that commit's files, for as long as the block runs."""
    with TemporaryDirectory(prefix="tsbench-state-") as folder:
        place = Path(folder) / "tsbench"
        _git(root, "worktree", "add", "--detach", str(place), commit)
        try:
            yield place
        finally:
            _git(root, "worktree", "remove", "--force", str(place))


def check_data(contracts: Mapping[str, Mapping[str, str]], code: str) -> None:
    """Are contracts those of today's scenes, signs and versions, with the code that has this hash?

    contracts: by city and split. Raises InputError where they are not.
    """
    for city, splits in contracts.items():
        with using_city(city):
            for split, contract in splits.items():
                if contract_hash(read_table(table_path(split)), load_catalog(), code) != contract:
                    raise InputError(
                        f"{city} {split}: scenes, signs or versions of packages are not those of the contract "
                        f"{contract[:12]}: this is another edition"
                    )


def compare_states(
    earlier: Path,
    now: Path,
    out: Path,
    planners: Sequence[str],
    limit: int,
    workers: int = 1,
) -> SameBytes:
    """Drive `dev` with the tsbench of two folders and compare every record, event and trace.

    out: an empty folder for the runs. planners: registered names; (): all that both have and that this machine can
    make. limit: at most so many scenes, spread over the types. Raises InputError for the first episode that differs.
    """
    chosen = list(planners) or sorted(set(_registered(earlier)) & set(_registered(now)))
    driven, digest, codes = [], hashlib.sha256(), {}
    episodes = 0
    for name in chosen:
        runs = [out / f"{name}-{state}" for state in ("earlier", "now")]
        made = [
            _drive(root, name, run, workers, limit) for root, run in zip((earlier, now), runs, strict=True)
        ]
        if made[0]:
            click.echo(f"{name}: not compared: {made[0]}")
            continue
        if made[1]:
            raise InputError(f"{name}: was driven by the earlier state, but not by this one: {made[1]}")
        count, found = _equal(name, *runs)
        click.echo(f"{name}: {count} episodes are equal")
        digest.update(found)
        driven.append(name)
        episodes += count
        before, after = map(_code_of, runs)
        if before != after:
            codes[name] = before, after
    if not driven:
        raise InputError("no planner could be driven: nothing was compared")
    return SameBytes(tuple(driven), episodes, digest.hexdigest(), codes)


def _code_of(run: Path) -> str:
    """SHA-256 (hex) of the code of the planner that drove a run."""
    (planner,) = json.loads((run / "run.json").read_text(encoding="utf-8"))["planners"]
    return str(planner["code_sha256"])


def _registered(root: Path) -> list[str]:
    """Names of the planners of a state. Raises InputError where its tsbench does not run."""
    told = _python(root, _NAMES)
    if told.returncode:
        raise InputError(f"{root}: its tsbench does not run here: {_last_line(told)}")
    return told.stdout.split()


def _drive(root: Path, planner: str, out: Path, workers: int, limit: int) -> str:
    """Drive a planner's sample into `out`; returns why it cannot be made here, "" where it was driven."""
    asked = (
        "--planner", planner, "--split", _SPLIT, "--trace", "all", "--workers", str(workers), "--out", str(out),
        "--limit", str(limit),
    )  # fmt: skip
    done = _python(root, _TSBENCH, "run", *asked)
    # 1: some episodes ended in an error outcome, which is a record like others.
    if done.returncode in (0, 1) and (out / _TABLES[0]).is_file():
        return ""
    return _last_line(done)


def _equal(planner: str, a: Path, b: Path) -> tuple[int, bytes]:
    """Episodes of a run and the SHA-256 of what they are. Raises InputError where another run has other ones."""
    digest = hashlib.sha256()
    for name in _TABLES:
        rows = [pq.read_table(run / name).to_pylist() for run in (a, b)]
        if rows[0] != rows[1]:
            first = next((x for x, y in zip(*rows, strict=False) if x != y), (rows[0] or rows[1])[-1])
            raise InputError(f"{planner}: {first['scenario_id']}: {name} differs: this is another edition")
        digest.update(repr(rows[0]).encode())
    traces = [
        {path.relative_to(run).as_posix(): path for path in run.glob("traces/**/*.parquet")} for run in (a, b)
    ]
    if traces[0].keys() != traces[1].keys() or not traces[0]:
        raise InputError(f"{planner}: the two states wrote different traces")
    for name in sorted(traces[0]):
        content = [files[name].read_bytes() for files in traces]
        if content[0] != content[1]:
            raise InputError(f"{planner}: {name} differs: this is another edition")
        digest.update(content[0])
    return pq.read_metadata(a / _TABLES[0]).num_rows, digest.digest()


def _python(root: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run code with the tsbench below `root` and its data."""
    environment = {k: v for k, v in os.environ.items() if k not in _ELSEWHERE}
    path = os.pathsep.join(filter(None, [str(root), environment.get("PYTHONPATH")]))
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=root, env={**environment, "PYTHONPATH": path},
        capture_output=True, text=True, check=False,
    )  # fmt: skip


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    """What a process said last, or how it ended where it said nothing."""
    said = (done.stderr or done.stdout).strip().splitlines()
    return said[-1] if said else f"exit code {done.returncode}"


def _git(root: Path, *arguments: str, optional: bool = False) -> str:
    """What git prints. optional: "" where it fails."""
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)
    if done.returncode and not optional:
        raise InputError(f"git {arguments[0]}: {done.stderr.strip() or done.returncode}")
    return "" if done.returncode else done.stdout


def compared_with(contract: str, planners: Sequence[str], workers: int) -> dict[str, SameResults]:
    """Compare today's code with the newest state that has `contract`, any split's; returns that state by city.

    planners: as for `compare_states`. Raises InputError where it is another edition, or where nothing can be compared.
    """
    for commit in commits_of(contract):
        with checked_out(commit) as place, TemporaryDirectory(prefix="tsbench-same-") as out:
            told = _python(place, _STATE)
            if told.returncode:
                raise InputError(f"{commit}: its tsbench does not run here: {_last_line(told)}")
            code, contracts = json.loads(told.stdout)
            # One that was changed before its contract was entered.
            if contract not in contracts[OWN_CITY].values():
                continue
            check_data(contracts, code)
            limit = _ROWS_OF_TYPE * len(load_catalog().types)
            found = compare_states(place, ROOT, Path(out), planners, limit, workers)
            return {
                city: SameResults(splits, code, str(found), found.codes) for city, splits in contracts.items()
            }
    raise InputError(
        f"no commit here is of the contract {contract}; a shallow clone lacks most (git fetch --unshallow)"
    )


@click.command()
@click.argument("contract")
@click.option("--planner", "planners", multiple=True, help="Registered planner to drive.  [default: all]")
@click.option("--workers", type=click.IntRange(1), default=own_cores)
def main(contract: str, planners: tuple[str, ...], workers: int) -> None:
    """Enter today's contracts beside those of the state that has CONTRACT, where both give the same bytes."""
    try:
        for city, splits in release_all(compared_with(contract, planners, workers)).items():
            for split, now in splits.items():
                click.echo(f"{city} {split} {now}")
    except InputError as problem:
        raise SystemExit(f"error: {problem}") from None


if __name__ == "__main__":
    main()
