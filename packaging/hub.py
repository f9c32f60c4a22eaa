"""Makes the folder that goes to a data set hub as it is: tables, scenes, data card, Croissant metadata, checksums.

python packaging/hub.py DIR [--revision TAG] [--published DAY]     DIR is made anew; needs the extra `release`
"""

from __future__ import annotations

import argparse
import datetime
import json
import shutil
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mlcroissant as mlc
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench import __version__
from tsbench.core.files import sha256_of
from tsbench.core.parquet import OSM_LICENCE
from tsbench.core.paths import SHIPPED_CITIES

ROOT = Path(__file__).resolve().parent.parent
CARD, ATTRIBUTION = ROOT / "docs" / "data-card.md", ROOT / "sumo_nets" / "ATTRIBUTION.md"
LICENCE_URL = "https://opendatacommons.org/licenses/odbl/1-0/"
PAGE = "https://pypi.org/project/tsbench/"
MOST_FILES = 100
# Splits with so many types and scenes that each type has a file of its own.
WIDE = ("test", "train")
SPLITS = ("dev", "test", "train", "holdout")
PARQUET = "application/x-parquet"
_TYPES = {
    "string": mlc.DataType.TEXT, "double": mlc.DataType.FLOAT, "bool": mlc.DataType.BOOL,
    "int32": mlc.DataType.INTEGER, "int64": mlc.DataType.INTEGER, "binary": mlc.DataType.TEXT,
}  # fmt: skip
# What the tables are, by the folder or file that they stand in.
_ABOUT = {
    "rows": "One row a scene: type, sign, half of its contrast pair, map, seeds, files and their hashes.",
    "scenes": "The files of scenes: SUMO networks, and additional files with plates, traffic and obstacles.",
    "certificates": "What was shown of each row: solvable, tempting, exclusive to its half, equal but for plates.",
    "maps": "The pool of crops of OpenStreetMap that scenes are placed on.",
}


# Croissant's fields for responsible AI, by the card's section that answers them: one text in one place.
_RESPONSIBLE = {
    "data_collection": "Where it comes from", "data_preprocessing_protocol": "How it was made",
    "data_annotation_protocol": "Who says what is right", "data_use_cases": "What it is for",
    "data_limitations": "What it does not show", "data_biases": "Whose streets", "data_social_impact": "Harm",
    "personal_sensitive_information": "People", "data_release_maintenance_plan": "Upkeep",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Table:
    """A Parquet file of the folder. name: relative to it. kind: a key of _ABOUT. sources: files it is made of."""

    name: str
    kind: str
    split: str
    sources: tuple[Path, ...]


def tables(root: Path = ROOT) -> list[Table]:
    """All that is here, Moscow first."""
    found = list(_tables_of(root, ""))
    for city in SHIPPED_CITIES:
        found += _tables_of(root / "cities" / "data" / city, f"cities/{city}/", wide=())
    return found


def _tables_of(root: Path, prefix: str, wide: Sequence[str] = WIDE) -> Iterable[Table]:
    scenarios = root / "scenarios"
    for split in SPLITS:
        rows, scenes = (scenarios / f"{split}.parquet", sorted((scenarios / "scenes" / split).glob("*.parquet")))
        if not rows.is_file():
            continue
        yield Table(f"{prefix}rows/{split}.parquet", "rows", split, (rows,))
        if split in wide:
            yield from (Table(f"{prefix}scenes/{split}/{path.name}", "scenes", split, (path,)) for path in scenes)
        else:
            yield Table(f"{prefix}scenes/{split}.parquet", "scenes", split, tuple(scenes))
    yield Table(f"{prefix}certificates.parquet", "certificates", "", (scenarios / "certificates.parquet",))
    yield Table(f"{prefix}maps/pool.parquet", "maps", "", (root / "sumo_nets" / "pool.parquet",))


def build(folder: Path, revision: str, published: datetime.date) -> list[str]:
    """Fill `folder`; the names of its files. Exits with a line where there would be more than a hub likes."""
    if folder.exists():
        shutil.rmtree(folder)
    laid = tables()
    for table in laid:
        target = folder / table.name
        target.parent.mkdir(parents=True, exist_ok=True)
        if len(table.sources) == 1:
            shutil.copyfile(table.sources[0], target)
        else:
            _join(table.sources, target)
    shutil.copyfile(ATTRIBUTION, folder / "ATTRIBUTION.md")
    (folder / "README.md").write_text(card(folder, laid), encoding="utf-8")
    (folder / "croissant.json").write_text(
        json.dumps(croissant(folder, laid, revision, published), indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    sums = "".join(f"{sha256_of(folder / name)}  {name}\n" for name in names)
    (folder / "SHA256SUMS").write_text(sums, encoding="utf-8")
    names = [*names, "SHA256SUMS"]
    if len(names) >= MOST_FILES:
        sys.exit(f"{folder}: {len(names)} files, fewer than {MOST_FILES} were meant: join more of them")
    return names


def _join(sources: Sequence[Path], target: Path) -> None:
    joined = pa.concat_tables([pq.read_table(path) for path in sources])
    pq.write_table(joined, target, compression="zstd", row_group_size=64)


def card(folder: Path, laid: Sequence[Table]) -> str:
    """The data card with a hub's head (what it shows in its viewer) and the counts of what is here."""
    configs = "".join(
        f"- config_name: {name}\n  data_files:\n"
        + "".join(f"  - split: {t.split}\n    path: {t.name}\n" for t in laid if t.name.startswith(prefix))
        for name, prefix in (("default", "rows/"), *((city, f"cities/{city}/rows/") for city in SHIPPED_CITIES))
    )
    head = (
        "---\nlicense: odbl\npretty_name: tsbench\nlanguage:\n- en\ntask_categories:\n- robotics\n"
        "tags:\n- autonomous-driving\n- traffic-signs\n- closed-loop\n- planning\n"
        f"size_categories:\n- 10K<n<100K\nconfigs:\n{configs}---\n\n"
    )
    counts = "".join(
        f"| `{t.name}` | {pq.read_metadata(folder / t.name).num_rows:,} |\n" for t in laid if t.kind == "rows"
    )
    return f"{head}{CARD.read_text(encoding='utf-8')}\n## Rows\n\n| table | rows |\n|---|---:|\n{counts}"


def croissant(folder: Path, laid: Sequence[Table], revision: str, published: datetime.date) -> dict[str, Any]:
    """Croissant 1.0 with the fields of its vocabulary for responsible AI; one set of records a table."""
    context = mlc.Context()
    parts = _card_parts()
    files = [_file(context, folder, table) for table in laid]
    told: dict[str, Any] = mlc.Metadata(
        ctx=context, date_published=datetime.datetime.combine(published, datetime.time()),
        name="tsbench", url=PAGE, version=__version__, license=[LICENCE_URL],
        description=parts[""], creators=[mlc.Organization(ctx=context, name="tsbench contributors")],
        keywords=["autonomous driving", "traffic signs", "closed loop", "planning", "SUMO", "OpenStreetMap"],
        cite_as=f"tsbench contributors. tsbench: a closed-loop benchmark for obeying traffic signs. {revision}.",
        distribution=files, record_sets=[_records(context, folder, table) for table in laid],
        **{field: parts[title] for field, title in _RESPONSIBLE.items()},
    ).to_json()  # fmt: skip
    return {**told, "conformsTo": [told["conformsTo"], "http://mlcommons.org/croissant/RAI/1.0"]}


def _file(context: mlc.Context, folder: Path, table: Table) -> mlc.FileObject:
    path = folder / table.name
    return mlc.FileObject(
        ctx=context, id=table.name, name=table.name, content_url=table.name, encoding_formats=[PARQUET],
        content_size=f"{path.stat().st_size} B", sha256=sha256_of(path),
        description=f"{_ABOUT[table.kind]} {OSM_LICENCE['licence']}.",
    )  # fmt: skip


def _records(context: mlc.Context, folder: Path, table: Table) -> mlc.RecordSet:
    name = table.name.removesuffix(".parquet")
    fields = [
        mlc.Field(
            ctx=context, id=f"{name}/{field.name}", name=field.name, data_types=[_TYPES[_kind(field)]],
            repeated=pa.types.is_list(field.type),
            source=mlc.Source(
                ctx=context, file_object=table.name, extract=mlc.Extract(ctx=context, column=field.name)
            ),
        )
        for field in pq.read_schema(folder / table.name)
    ]  # fmt: skip
    return mlc.RecordSet(ctx=context, id=name, name=name, description=_ABOUT[table.kind], fields=fields)


def _kind(field: pa.Field) -> str:
    """Of what a column holds, or a list in it."""
    return str(field.type.value_type if pa.types.is_list(field.type) else field.type)


def _card_parts() -> dict[str, str]:
    """The card's sections by title, each as one line; "": what stands before the first."""
    first, *sections = CARD.read_text(encoding="utf-8").split("\n## ")
    parts = {"": first.partition("\n")[2]}
    for section in sections:
        title, _, text = section.partition("\n")
        parts[title] = text
    return {title: " ".join(text.split()) for title, text in parts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--revision", default="unreleased")
    parser.add_argument("--published", type=datetime.date.fromisoformat, default=datetime.date(1970, 1, 1))
    asked = parser.parse_args()
    names = build(asked.folder, asked.revision, asked.published)
    size = sum((asked.folder / name).stat().st_size for name in names)
    print(f"{asked.folder}: {len(names)} files, {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
