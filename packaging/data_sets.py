"""Makes the manifest of the data, and the folder that `tsbench data fetch --from` reads.

python packaging/data_sets.py manifest       writes tsbench/core/data_manifest.json from the files that are here
python packaging/data_sets.py lay-out DIR    copies the sets' files to DIR, each checked
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from tsbench.core.fetch import MANIFEST, SCHEMA_VERSION, DataFile, data_set, data_sets, sha256_of
from tsbench.core.paths import SHIPPED_CITIES

ROOT = Path(__file__).resolve().parent.parent
# By name: what it is, and its files. `test` is what the wheel tsbench-data carries (tsbench-data/hatch_build.py).
SETS = {
    "test": (
        "the dev and test splits, certificates, recipes, pool of maps: the package tsbench-data",
        (
            "scenarios/dev.parquet",
            "scenarios/scenes/dev/*",
            "scenarios/test.parquet",
            "scenarios/scenes/test/*",
            "scenarios/two-signs*.parquet",
            "scenarios/scenes/two-signs*/*",
            "scenarios/certificates.parquet",
            "scenarios/build_report.json",
            "scenarios/editions.yaml",
            "scenarios/nuplan_statistics.json",
            "scenarios/recipes/*",
            "cities/*.yaml",
            "sumo_nets/*",
            "sumo_nets/netconvert/*",
        ),
    ),
    "sources": ("the extracts of OpenStreetMap that Moscow's maps are cut from", ("sumo_nets/sources/*.osm.gz",)),
    "holdout": ("the holdout split", ("scenarios/holdout.parquet", "scenarios/scenes/holdout/*")),
    "train": ("the train split", ("scenarios/train.parquet", "scenarios/scenes/train/*")),
    **{
        city: (
            f"the city {city}: the pool, dev and test splits with certificates",
            tuple(f"cities/data/{city}/{part}" for part in ("*", "sumo_nets/*", "scenarios/*", "scenarios/scenes/*/*")),
        )
        for city in SHIPPED_CITIES
    },
    "oracle": (
        "the oracle's drives of edition 2026.1's train split",
        ("scenarios/oracle.json", "scenarios/oracle*.parquet"),
    ),
}


def files_of(patterns: tuple[str, ...], root: Path = ROOT) -> dict[str, DataFile]:
    """The files below `root`, by name, as they are now."""
    paths = sorted({path for pattern in patterns for path in root.glob(pattern) if path.is_file()})
    names = [path.relative_to(root).as_posix() for path in paths]
    return {n: DataFile(n, p.stat().st_size, sha256_of(p)) for n, p in zip(names, paths, strict=True)}


def manifest() -> str:
    """The manifest of what is here; the oracle's tables, which a clone need not have, stay as they were known."""
    lines = []
    for name, (about, patterns) in SETS.items():
        known = {file.name: file for file in data_set(name).files} if name == "oracle" else {}
        files = sorted((known | files_of(patterns)).items())
        if not files:
            continue
        told = ",\n".join(f"    {json.dumps([f.name, f.size, f.sha256])}" for _, f in files)
        lines.append(f'  "{name}": {{\n   "about": {json.dumps(about)},\n   "files": [\n{told}\n   ]\n  }}')
    return f'{{\n "schema_version": {SCHEMA_VERSION},\n "sets": {{\n' + ",\n".join(lines) + "\n }\n}\n"


def lay_out(folder: Path) -> None:
    """Copy every set that is here as a whole; exits with a line where a file is not the manifest's."""
    for data in data_sets().values():
        missing = [file.name for file in data.files if not (ROOT / file.name).is_file()]
        if missing:
            print(f"{data.name}: left out, {missing[0]} is not here (docs/install.md says how to get it)")
            continue
        for file in data.files:
            if not file.is_at(ROOT / file.name):
                sys.exit(f"{file.name}: is not the file that the manifest names: make manifest")
            (folder / file.name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file.name, folder / file.name)
        print(f"{data.name}: {len(data.files)} files, {data.size / 1e6:.1f} MB, in {folder}")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["manifest"]:
            MANIFEST.write_text(manifest(), encoding="utf-8")
        case ["lay-out", folder]:
            lay_out(Path(folder))
        case _:
            sys.exit(__doc__)
