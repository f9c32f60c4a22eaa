"""What a clone has besides code and tables, with a made-up town as a city that is not built yet."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from town import make_town

from tsbench.cli import main
from tsbench.core import paths as repository_paths
from tsbench.core.paths import CITY
from tsbench.make.maps.utm import UtmFrame
from tsbench.scenarios.data_set import DataSet

REPOSITORY = Path(__file__).resolve().parents[2]
NORTH = 5_540_000.0


@contextmanager
def town_clone(root: Path) -> Iterator[Path]:
    """The town is the city `nowhere` of zone 32; all of it is dev."""
    shutil.copytree(REPOSITORY / "sumo_nets" / "netconvert", root / "sumo_nets" / "netconvert")
    shutil.copytree(REPOSITORY / "scenarios" / "recipes", root / "scenarios" / "recipes")
    shutil.copy(REPOSITORY / "scenarios" / "nuplan_statistics.json", root / "scenarios")
    shutil.copytree(REPOSITORY / "sign_catalog", root / "sign_catalog")
    shutil.copytree(REPOSITORY / "cities", root / "cities", ignore=shutil.ignore_patterns("data"))
    extract = root / "osm" / "nowhere.osm"
    extract.parent.mkdir()
    extract.write_text(make_town().xml(UtmFrame(32), NORTH), encoding="utf-8")
    digest = hashlib.sha256(extract.read_bytes()).hexdigest()
    city = yaml.safe_load((root / "cities" / "north-bayreuth.yaml").read_text())
    city |= {"city": "nowhere", "split": {"tile_m": 2000, "test_share": 0.0}, "maps": {"dev": 1}}
    city["extracts"] = [
        city["extracts"][0] | {"name": "nowhere", "code": "now", "sha256": digest, "bytes": extract.stat().st_size}
    ]
    (root / "cities" / "nowhere.yaml").write_text(yaml.safe_dump(city))
    (root / "cities" / "elsewhere.yaml").write_text(yaml.safe_dump(city | {"city": "elsewhere", "zone": 33}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TSBENCH_DATA", str(root))
        patch.delenv(CITY, raising=False)
        patch.setenv("COLUMNS", "200")
        repository_paths.data_root.cache_clear()
        yield root
    repository_paths.data_root.cache_clear()


def call(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 0) -> str:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    told = capsys.readouterr()
    assert ended.value.code == code, told.out + told.err
    assert DataSet.in_use().name == "moscow", "a command leaves its city behind"
    if code:
        assert told.err.strip().count("\n") == 0, told.err
    return told.out + told.err
