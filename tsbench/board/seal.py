"""A sealed data set: scenes that are drawn with a secret, and what is published of them before they are.

Published are a hash of every file and of the secret. Later come the files; the hashes prove that they are those
that were meant then. With the secret and the extracts the same files can be made again.
"""

from __future__ import annotations

import re
import secrets
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, sha256_of, write_json
from tsbench.core.paths import OWN_CITY
from tsbench.core.textfile import read_json
from tsbench.make.city import load_city
from tsbench.make.seeds import secret_sha256, using_secret
from tsbench.run.edition import contract_now, edition_now
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from tsbench.make.scenes.build import Progress, TypeReport

SCHEMA_VERSION: Literal[1] = 1
_SEAL = "seal.json"
# What a build leaves beside its data, to go on after a break; and the seal itself.
_NOT_DATA = re.compile(r"(scenarios|sumo_nets)/build/.*|seal\.json")


@dataclass(frozen=True)
class Commitments:
    """What is published of a sealed data set.

    Attributes
    ----------
        schema: version of this file.
        name, title, edition: of the data set.
        contracts: hash by split.
        secret_sha256: of the secret (`dataset.seeds.secret_sha256`).
        rows: number by split and type of the signed half, both halves.
        files: SHA-256 (hex) by name, below the data set's folder.
    """

    schema: Literal[1]
    name: str
    title: str
    edition: str
    contracts: Mapping[str, str]
    secret_sha256: str
    rows: Mapping[str, Mapping[str, int]]
    files: Mapping[str, str]


def make_secret(path: Path) -> None:
    """Write a new secret of 256 bits that only its owner can read. Raises InputError where a file is."""
    with io_errors_as_input_errors(path):
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(f"{secrets.token_hex(32)}\n", encoding="utf-8")


def build_sealed(
    data: DataSet, types: Sequence[str], osm: Path, secret: Path, workers: int, progress: Progress
) -> list[TypeReport]:
    """As `build_city`, drawn with a secret. Raises InputError where what is there was drawn with another, or none."""
    from tsbench.make.scenes.build import build_city  # brings pyosmium and SUMO

    place, digest = data.folder / _SEAL, secret_sha256(secret)
    if place.is_file():
        if read_json(place, "seal").get("secret_sha256") != digest:
            raise InputError(f"{place}: this data set was begun with another secret: go on with that, or move it away")
    elif data.name != OWN_CITY and (data.folder / "scenarios").exists():
        raise InputError(f"{data.folder}: was built without a secret: move it away, or describe a city of another name")
    else:
        write_json(place, {"secret_sha256": digest})
    with using_secret(secret):
        return build_city(data, tuple(types), osm, workers, progress)


def commitments(data: DataSet) -> Commitments:
    """Of a data set. Raises InputError where it is not sealed, or not built."""
    place = data.folder / _SEAL
    if not place.is_file():
        raise InputError(f"{place}: not there, so this data set is not sealed: tsbench seal build makes one that is")
    city, splits = load_city(data.name), data.splits
    if not splits:
        raise InputError(f"{data.folder}: nothing is built yet: tsbench seal build {city.name}")
    rows = {split: Counter(row.pair_type for row in data.table(split)) for split in splits}
    return Commitments(
        SCHEMA_VERSION,
        city.name,
        city.title,
        edition_now(data),
        {split: contract_now(data, split) for split in splits},
        read_json(place, "seal")["secret_sha256"],
        {split: dict(sorted(counts.items())) for split, counts in rows.items()},
        _files(data.folder),
    )


def problems(published: Commitments, secret: Path | None) -> list[str]:
    """What of the city's data set that is here, and of the secret, is not what was published; [] where all of it is."""
    here = _files(DataSet.named(published.name).folder)
    found = [f"{name}: was committed to and is not here" for name in sorted(set(published.files) - set(here))]
    found += [f"{name}: is here and was not committed to" for name in sorted(set(here) - set(published.files))]
    found += [
        f"{name}: has SHA-256 {here[name][:12]}…, {published.files[name][:12]}… was committed to"
        for name in sorted(set(here) & set(published.files))
        if here[name] != published.files[name]
    ]
    if secret is not None and secret_sha256(secret) != published.secret_sha256:
        found.append(f"{secret}: is not the secret that was committed to")
    return found


def _files(root: Path) -> dict[str, str]:
    names = sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    return {name: sha256_of(root / name) for name in names if not _NOT_DATA.fullmatch(name)}
