"""`tsbench city build` on extracts that nobody prepared: each ends in a data set, or in one line that says why not."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml
from odd_extracts import BUILT, grid
from town_clone import town_clone

from tsbench.cli import main

# Five hundred junctions are read in a test of their own; to cut and build as many takes minutes.
SMALLER = {"grid.osm": lambda: grid(4, 3)}


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with town_clone(tmp_path_factory.mktemp("odd")) as root:
        yield root


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(BUILT))
def test_an_odd_extract_ends_in_a_data_set_or_in_a_line(
    file: str, clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = file.partition(".")[0], {**BUILT, **SMALLER}[file]()
    (clone / "osm" / file).write_bytes(content)
    city = yaml.safe_load((clone / "cities" / "nowhere.yaml").read_text())
    digest = hashlib.sha256(content).hexdigest()
    city["extracts"][0] |= {"name": name, "code": name[:3], "sha256": digest, "bytes": len(content)}
    (clone / "cities" / f"{name}.yaml").write_text(yaml.safe_dump(city | {"city": name}))
    with pytest.raises(SystemExit) as ended:
        main(["city", "build", name, "--osm", str(clone / "osm"), "--types", "yield", "--workers", "1"])
    told = capsys.readouterr()
    data = clone / "cities" / "data" / name
    if ended.value.code:
        assert (ended.value.code, told.err.strip().count("\n")) == (2, 0), told.err
        assert told.err.startswith("error: ")
        assert not (data / "edition.yaml").exists()
    else:
        rows = pq.read_table(data / "scenarios" / "dev.parquet").to_pylist()
        assert {(row["split"], row["half"]) for row in rows} == {("dev", "signed"), ("dev", "contrast")}
        assert (data / "edition.yaml").exists()
