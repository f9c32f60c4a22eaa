"""`rescored.json`: that a run was judged again, what of it, by what, and how that ended."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_json
from tsbench.core.typed import read_typed
from tsbench.run.edition import edition_here, standing_contract
from tsbench.run.log.tables import file_hashes
from tsbench.scenarios.data_set import DataSet

NAME = "rescored.json"
SCHEMA_VERSION: Literal[1] = 1
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
    schema_version: Literal[1] = SCHEMA_VERSION


def write_rescored(folder: Path, data: DataSet, contract: str, traces: int, untraced: int, disagreements: int) -> None:
    """Write down how judging a run again ended. Raises InputError where the folder takes nothing."""
    hashes = file_hashes(folder)
    judged, edition = {name: hashes[name] for name in _JUDGED}, edition_here(contract, data)
    told = Rescored(judged, contract, edition, tsbench.__version__, traces, untraced, disagreements)
    with io_errors_as_input_errors(folder):
        write_json(folder / NAME, {"schema_version": SCHEMA_VERSION, **asdict(told)})


def read_rescored(folder: Path) -> Rescored | None:
    """What `write_rescored` wrote, None where it wrote nothing. Raises InputError for anything else."""
    path = folder / NAME
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
