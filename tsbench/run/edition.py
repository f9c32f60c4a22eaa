"""Editions: the names that people cite for contracts, and the hashes that were released under them.

`python -m tsbench.run.edition` writes the hashes of this tsbench into `editions.yaml`; a test holds them to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path

import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.paths import (
    MIRRORED,
    OWN_CITY,
    SHIPPED_CITIES,
    city_in_use,
    data_file,
    dataset_root,
    using_city,
)
from tsbench.run.contract import contract_hash, mirrored_contract
from tsbench.scenarios.editions import scene_editions
from tsbench.scenarios.table import read_table, splits_there, table_path
from tsbench.signs.catalog import load_catalog

PATH = Path(__file__).with_name("editions.yaml")
LOCAL = "+local"
_OF_CITY = "edition.yaml"  # beside the data of a city
_HEAD = (
    "# Editions, oldest first: docs/editions.md says what each is. released: contract hash of each split, by version\n"
    "# of tsbench. same: earlier contracts with the same results, oldest first.\n"
    "# Written by `make edition`; titles by hand.\n"
)


@dataclass(frozen=True)
class SameResults:
    """An earlier state of the code that gave the same bytes as the one after it (`tools.same_edition`).

    contracts: of that state, by split. code: SHA-256 (hex) of its code. compared: what both states drove. planners: of
    those that drove and whose code differs, the SHA-256 (hex) of their code in that state and in the one after it.
    """

    contracts: Mapping[str, str]
    code: str
    compared: str
    planners: Mapping[str, Sequence[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Edition:
    """name: as cited, such as "2026.1". title: one line. released: contract by split, by version of tsbench.

    same: earlier states with the results of the newest version, oldest first.
    """

    name: str
    title: str
    released: Mapping[str, Mapping[str, str]]
    same: tuple[SameResults, ...] = ()

    def now(self) -> Mapping[str, str]:
        """The contracts of the newest version, by split."""
        return list(self.released.values())[-1]

    def standing(self) -> dict[str, str]:
        """For each contract of the newest version and of the states under `same`: the oldest with the same results."""
        states = [*(state.contracts for state in self.same), self.now()]
        oldest = {split: contract for state in reversed(states) for split, contract in state.items()}
        return {contract: oldest[split] for state in states for split, contract in state.items()}

    def contracts(self) -> set[str]:
        """All contracts under this name."""
        released = {contract for splits in self.released.values() for contract in splits.values()}
        return released | self.standing().keys()


@cache
def editions() -> tuple[Edition, ...]:
    """All editions, oldest first; the last one is what this tsbench runs."""
    return _read(PATH)


def _read(path: Path) -> tuple[Edition, ...]:
    found = []
    for entry in yaml.safe_load(path.read_text(encoding="utf-8")):
        states = tuple(SameResults(**state) for state in entry.pop("same", ()))
        found.append(Edition(**entry, same=states))
    return tuple(found)


def edition_of(contract: str, told: object = "") -> str:
    """The edition that a contract was released under, else one with "+local": something in it has been changed.

    told: what the run that has this contract says of its edition. It is believed only as far as which one was changed.
    """
    for edition in _all_editions():
        known = edition.contracts()
        if contract in known:
            return edition.name
        if contract in map(mirrored_contract, known):
            return _mirrored_name(edition.name)
    name = told.removesuffix(LOCAL) if isinstance(told, str) and told else edition_now()
    return f"{name}{LOCAL}"


def standing_contract(contract: str) -> str:
    """The contract that results are compared under: the oldest that has the same results, or `contract` itself."""
    for edition in _all_editions():
        for known, oldest in edition.standing().items():
            if contract == known:
                return oldest
            if contract == mirrored_contract(known):
                return mirrored_contract(oldest)
    return contract


def is_same_planner(name: str, earlier: str | None, now: str | None) -> bool:
    """Are these the hashes of one registered planner's code, with states between them that gave the same bytes?"""
    for edition in editions():
        reached = [earlier]
        for state in edition.same:
            if name in state.planners and state.planners[name][0] == reached[-1]:
                reached.append(state.planners[name][1])
        if now in reached:
            return True
    return False


def _mirrored_name(name: str) -> str:
    own = name in {edition.name for edition in editions()}
    return f"{MIRRORED}{OWN_CITY}-{name}" if own else f"{MIRRORED}{name}"


def edition_now() -> str:
    """The edition that is run here: `2026.2`, of another city `north-bayreuth-2026.2`."""
    city, name = city_in_use(), editions()[-1].name
    return name if city == OWN_CITY else f"{city}-{name}"


def built_editions() -> tuple[Edition, ...]:
    """Those of other cities whose data sets were built here, by city."""
    paths = sorted(data_file("cities/data").glob(f"*/{_OF_CITY}"))
    return tuple(edition for path in paths for edition in _read(path))


def _all_editions() -> Iterator[Edition]:
    """Those of the benchmark, then those of other cities, whose files are read only where that far is asked."""
    yield from editions()
    yield from built_editions()


def contract_now(split: str) -> str:
    """The contract hash of a split with this tsbench and its data."""
    return contract_hash(read_table(table_path(split)), load_catalog())


def earlier_splits(root: Path | None = None) -> dict[str, str]:
    """The splits whose scenes are still of an earlier edition, and which: they belong to none that is run here."""
    return {split: name for split, name in scene_editions(root).items() if name != editions()[-1].name}


def release_city(title: str, same: SameResults | None = None) -> Mapping[str, str]:
    """Write the contracts of the city in use down, with this tsbench and what was built; returns them by split.

    same: as for `release`.
    """
    now = {split: contract_now(split) for split in splits_there()}
    scenes = dict.fromkeys(now, editions()[-1].name)
    write_atomic(dataset_root() / "scenarios" / "editions.yaml", yaml.safe_dump(scenes).encode())
    path = dataset_root() / _OF_CITY
    (before,) = _read(path) if path.is_file() else (None,)
    states = () if before is None or before.name != edition_now() else _same(before, now, same)
    _write((Edition(edition_now(), title, {tsbench.__version__: now}, states),), path)
    return now


def release(same: SameResults | None = None) -> Mapping[str, str]:
    """Write the contracts of this tsbench down as those of its version; returns them by split.

    same: the state before, where it was shown to have the same results. Without it, no earlier state is known to have
    the results of changed contracts; splits whose contracts have not changed keep theirs.
    """
    *older, last = editions()
    now = {split: contract_now(split) for split in splits_there() if split not in earlier_splits()}
    newest = replace(last, released={**last.released, tsbench.__version__: now}, same=_same(last, now, same))
    _write((*older, newest), PATH)
    return now


def _same(before: Edition, now: Mapping[str, str], same: SameResults | None) -> tuple[SameResults, ...]:
    """The states with the results of `now`. Where a split's contract has changed, nothing of before has its results."""
    if same is None:
        kept = {split for split, contract in before.now().items() if now.get(split) == contract}
        left = (
            replace(state, contracts={k: v for k, v in state.contracts.items() if k in kept})
            for state in before.same
        )
        return tuple(state for state in left if state.contracts)
    if dict(same.contracts) != dict(before.now()):
        raise InputError(f"{before.name}: the state that was compared is not the one that was entered last")
    return (*before.same, same)


def _write(all_of_them: Sequence[Edition], path: Path) -> None:
    text = yaml.safe_dump(
        [_plain(edition) for edition in all_of_them], sort_keys=False, allow_unicode=True, width=120
    )
    write_atomic(path, f"{_HEAD}{text}".encode())


def _plain(edition: Edition) -> dict[str, object]:
    found = asdict(edition)
    for state in found["same"]:
        state["planners"] = {name: list(codes) for name, codes in state["planners"].items()}
    found["same"] = [{key: value for key, value in state.items() if value} for state in found["same"]]
    return found if edition.same else {key: value for key, value in found.items() if key != "same"}


def shipped_titles() -> dict[str, str]:
    """Cities that are released with tsbench and are here, with the titles of their editions."""
    named = {edition.name: edition.title for edition in built_editions()}
    cities = {city: f"{city}-{editions()[-1].name}" for city in SHIPPED_CITIES}
    return {city: named[name] for city, name in cities.items() if name in named}


def release_all(same: Mapping[str, SameResults] | None = None) -> Mapping[str, Mapping[str, str]]:
    """Write the contracts of this tsbench and of the cities that come with it down; returns them by city and split.

    same: by city, as for `release`.
    """
    states = same or {}
    found = {OWN_CITY: release(states.get(OWN_CITY))}
    for city, title in shipped_titles().items():
        with using_city(city):
            found[city] = release_city(title, states.get(city))
    return found


if __name__ == "__main__":
    try:
        for city, contracts in release_all().items():
            for name, contract in contracts.items():
                print(f"{city} {name} {contract}")
    except InputError as problem:
        raise SystemExit(f"error: {problem}") from None
