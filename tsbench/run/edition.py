"""Contracts, the fingerprints of all that must be equal for two scores to be comparable; and editions.

Editions are the names that people cite for contracts, and the hashes that were released under them.

`make edition` writes the contracts of this tsbench into `editions.yaml`; a test holds them to it.
"""

from __future__ import annotations

import base64
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of, write_atomic
from tsbench.core.paths import MIRRORED, OWN_CITY, SHIPPED_CITIES, data_file
from tsbench.core.provenance import data_hash, digest, versions
from tsbench.core.typed import read_typed
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec
from tsbench.signs.catalog import Catalog

# Version of what the code makes of scenes: records, events and traces, tsbench's own planners included. A change of one
# byte raises it; tests/test_golden.py fails until then.
SCORING = 3

_PACKAGE = Path(tsbench.__file__).resolve().parent
_CODE = frozenset((".py", ".yaml", ".json", ".csv"))


def contract_hash(rows: Sequence[ScenarioSpec], catalog: Catalog) -> str:
    """SHA-256 (hex) over the scoring number, the rows, their signs with rules, and versions of packages.

    Rows hold the hashes of their scene files. The arithmetic of a processor is no part of it: `run.json` records it.
    The contract of a mirrored data set follows from that of the data set that it mirrors.
    """
    if catalog.image is not None:
        stored = [mirrored_row(row, catalog.image) for row in rows]
        return mirrored_contract(contract_hash(stored, catalog.image))
    contrast = any(row.half == CONTRAST for row in rows)
    several = {kind.id: kind.codes for kind in catalog.combined}
    codes = {code for row in rows for code in (row.sign_code, *several.get(row.pair_type, ()))}
    rules = catalog.contract_entries(codes, contrast)
    return digest({"scoring": SCORING, "data": data_hash(rows, rules), "versions": versions()})


def mirrored_contract(contract: str) -> str:
    """The contract of a data set's mirror image, by its own."""
    return digest({"mirrored": contract})


@cache
def code_hash() -> str:
    """SHA-256 (hex) of the files of tsbench's package: code, and settings beside it."""
    return digest({path.relative_to(_PACKAGE).as_posix(): sha256_of(path) for path in _code_files()})


def code_stamps() -> dict[Path, tuple[int, int]]:
    """Size and time of the last change, ns, of each file of the package: others once a file was written."""
    return {path: ((found := path.stat()).st_size, found.st_mtime_ns) for path in _code_files()}


def _code_files() -> list[Path]:
    return sorted(path for path in _PACKAGE.rglob("*") if path.suffix in _CODE and path.is_file())


@cache
def code_is_local() -> bool:
    """Does the package differ from what was released?

    An installed package is compared with the hashes that its wheel came with, a clone with its last commit. Of a copy
    that is neither nothing is known, and it counts as changed.
    """
    released = _released_hashes()
    if released:
        there = {path.relative_to(_PACKAGE).as_posix(): path for path in _code_files()}
        return any(name not in released or _recorded(path) != released[name] for name, path in there.items())
    root = _PACKAGE.parent
    if not (root / ".git").exists():
        return True
    command = ["git", "-C", str(root), "status", "--porcelain", "--", _PACKAGE.name]
    try:
        return bool(subprocess.run(command, capture_output=True, timeout=10, check=True).stdout.strip())
    except (OSError, subprocess.SubprocessError):
        return True


def _released_hashes() -> dict[str, str]:
    """Hashes of the package's files in the RECORD of an installed wheel; {} for a clone."""
    prefix = f"{_PACKAGE.name}/"
    try:
        listed = files(_PACKAGE.name) or []
    except PackageNotFoundError:
        return {}
    own = {file.as_posix(): file for file in listed if file.as_posix().startswith(prefix)}
    init = own.get(f"{prefix}__init__.py")
    if init is None or Path(str(init.locate())).resolve() != _PACKAGE / "__init__.py":
        return {}
    return {name.removeprefix(prefix): file.hash.value for name, file in own.items() if file.hash is not None}


def _recorded(path: Path) -> str:
    """SHA-256 as RECORD has it: base64 for URLs, without padding."""
    return base64.urlsafe_b64encode(bytes.fromhex(sha256_of(path))).rstrip(b"=").decode()


PATH = Path(__file__).with_name("editions.yaml")
LOCAL = "+local"
_OF_CITY = "edition.yaml"  # beside the data of a city
_HEAD = (
    "# Editions, oldest first: docs/editions.md says what each is. released: contract hash of each split, by version\n"
    "# of tsbench. earlier: older contracts with the same results, of which the first is shown. scoring: the number\n"
    "# that judged those, where it was raised since: they are known, and no other contract has their results.\n"
    "# Written by `make edition`; titles and scoring by hand.\n"
)


@dataclass(frozen=True)
class Edition:
    """An edition.

    name: as cited, such as "2026.1".
    title: one line.
    released: contract by split, by version of tsbench.
    earlier: by split, contracts from before there were scoring numbers, oldest first; their results are those of the
    newest version.
    scoring: None, or the scoring that judged the results under `earlier`: not those of the newest version then.
    """

    name: str
    title: str
    released: Mapping[str, Mapping[str, str]]
    earlier: Mapping[str, Sequence[str]] = field(default_factory=dict)
    scoring: int | None = None

    def now(self) -> Mapping[str, str]:
        """The contracts of the newest version, by split."""
        return list(self.released.values())[-1]

    def standing(self) -> dict[str, str]:
        """For each contract that has results of others: the contract that these were published under."""
        now = self.now() if self.scoring in (None, SCORING) else {}
        same = ([*known, now.get(split, known[0])] for split, known in self.earlier.items())
        return {contract: known[0] for known in same for contract in known}

    def kept(self, split: str) -> str:
        """The contract that the published results of a split are shown under."""
        return self.earlier.get(split, [self.now()[split]])[0]

    def contracts(self) -> set[str]:
        """All contracts under this name."""
        released = {contract for splits in self.released.values() for contract in splits.values()}
        return released | self.standing().keys()


@cache
def editions() -> tuple[Edition, ...]:
    """All editions, oldest first; the last one is what this tsbench builds."""
    return _read(PATH)


def _read(path: Path) -> tuple[Edition, ...]:
    return read_typed(tuple[Edition, ...], path, "list of editions")


def edition_here(contract: str, data: DataSet) -> str:
    """The edition of what this tsbench drives or judges; with "+local" where its code is not as released, too."""
    return edition_of(contract, f"{edition_now(data)}{LOCAL}" if code_is_local() else "", data)


def edition_of(contract: str, told: object, data: DataSet) -> str:
    """The edition that a contract was released under, with "+local" where data or code were changed since.

    told: what the run that has this contract says of its edition: that its code was changed, and which edition an
    unknown contract comes from; of one that says nothing it is that of `data`.
    """
    said = told if isinstance(told, str) and told else ""
    local = LOCAL if said.endswith(LOCAL) else ""
    for edition in _all_editions():
        known = edition.contracts()
        if contract in known:
            return f"{edition.name}{local}"
        if contract in map(mirrored_contract, known):
            return f"{_mirrored_name(edition.name)}{local}"
    return f"{said.removesuffix(LOCAL) or edition_now(data)}{LOCAL}"


def contract_line(contract: str, data: DataSet) -> str:
    """A contract with its edition, as a run's end and tables name it."""
    return f"edition {edition_of(contract, '', data)}, contract {contract}"


def standing_contract(contract: str) -> str:
    """The contract that results are shown and compared under: the first published one that has the same results."""
    for edition in _all_editions():
        for known, first in edition.standing().items():
            if contract == known:
                return first
            if contract == mirrored_contract(known):
                return mirrored_contract(first)
    return contract


def _mirrored_name(name: str) -> str:
    own = name in {edition.name for edition in editions()}
    return f"{MIRRORED}{OWN_CITY}-{name}" if own else f"{MIRRORED}{name}"


def in_force(data: DataSet) -> Edition:
    """The edition of a data set: that of its test split's scenes, the last one where there are none."""
    name = data.editions().get("test")
    return next((edition for edition in editions() if edition.name == name), editions()[-1])


def edition_now(data: DataSet) -> str:
    """The edition that is run here: `2026.2`, of another city `north-bayreuth-2026.2`."""
    name = in_force(data).name
    return name if data.name == OWN_CITY else f"{data.name}-{name}"


def built_editions() -> tuple[Edition, ...]:
    """Those of other cities whose data sets were built here, by city."""
    paths = sorted(data_file("cities/data").glob(f"*/{_OF_CITY}"))
    return tuple(edition for path in paths for edition in _read(path))


def _all_editions() -> Iterator[Edition]:
    """Those of the benchmark, then those of other cities, whose files are read only where that far is asked."""
    yield from editions()
    yield from built_editions()


def contract_now(data: DataSet, split: str) -> str:
    """The contract hash of a split with this tsbench and its data."""
    return contract_hash(data.table(split), data.catalog)


def earlier_splits(data: DataSet) -> dict[str, str]:
    """The splits whose scenes are of an earlier edition than that in force, and which: none that is run here."""
    names = [edition.name for edition in editions()]
    older = names[: names.index(in_force(data).name)]
    return {split: name for split, name in data.editions().items() if name in older}


def release_city(data: DataSet, title: str) -> Mapping[str, str]:
    """Write the contracts of a city down, with this tsbench and what was built; returns them by split."""
    now = {split: contract_now(data, split) for split in data.splits}
    path = data.folder / _OF_CITY
    (before,) = _read(path) if path.is_file() else (None,)
    if before is None or before.name != edition_now(data):
        before = Edition(edition_now(data), title, {})
    earlier = _still_the_same(before, now) if before.released else {}
    _write((replace(before, title=title, released={tsbench.__version__: now}, earlier=earlier),), path)
    return now


def release() -> Mapping[str, str]:
    """Write the contracts of this tsbench down as those of its version, in their scenes' editions.

    Returns: contract by split.
    """
    data = DataSet()
    now = {split: contract_now(data, split) for split in data.splits if split not in earlier_splits(data)}
    scenes, last = data.editions(), editions()[-1].name
    _write([_entered(e, {s: c for s, c in now.items() if scenes.get(s, last) == e.name}) for e in editions()], PATH)
    return now


def _entered(before: Edition, now: Mapping[str, str]) -> Edition:
    """The edition with contracts of this version; those that it has for other splits stay."""
    if not now:
        return before
    known = before.released.get(tsbench.__version__, {})
    released = {**before.released, tsbench.__version__: {**known, **now}}
    return replace(before, released=released, earlier=_still_the_same(before, now))


def _still_the_same(before: Edition, now: Mapping[str, str]) -> dict[str, Sequence[str]]:
    """Earlier contracts, but of splits whose contract has changed: another one has other results."""
    if before.scoring not in (None, SCORING):
        return dict(before.earlier)
    changed = {split for split, contract in now.items() if before.now().get(split) != contract}
    return {split: known for split, known in before.earlier.items() if split not in changed}


def _write(all_of_them: Sequence[Edition], path: Path) -> None:
    text = yaml.safe_dump([_plain(edition) for edition in all_of_them], sort_keys=False, allow_unicode=True, width=120)
    write_atomic(path, f"{_HEAD}{text}".encode())


def _plain(edition: Edition) -> dict[str, object]:
    return {key: value for key, value in asdict(edition).items() if value}


def shipped_titles() -> dict[str, str]:
    """Cities that are released with tsbench and are here, with the titles of their editions."""
    titles = {edition.name.rpartition("-")[0]: edition.title for edition in built_editions()}
    return {city: titles[city] for city in SHIPPED_CITIES if city in titles}


def release_all() -> Mapping[str, Mapping[str, str]]:
    """Write the contracts of this tsbench and of the cities that come with it down; returns them by city and split."""
    found = {OWN_CITY: release()}
    for city, title in shipped_titles().items():
        found[city] = release_city(DataSet(city), title)
    return found


if __name__ == "__main__":
    try:
        for city, contracts in release_all().items():
            for name, contract in contracts.items():
                print(f"{city} {name} {contract}")
    except InputError as problem:
        raise SystemExit(f"error: {problem}") from None
