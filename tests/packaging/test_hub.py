"""The folder for a data set hub, and what a release is made of."""

from __future__ import annotations

import datetime
import json
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml

from tsbench.core.files import sha256_of
from tsbench.scenarios.data_set import DataSet

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
DAY = datetime.date(2026, 11, 24)


@pytest.fixture(scope="module")
def hub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hub") / "tsbench"
    command = ("packaging/hub.py", str(folder), "--revision", "v9", "--published", DAY.isoformat())
    subprocess.run([sys.executable, *command], cwd=ROOT, check=True, capture_output=True)
    return folder


def test_croissant_is_valid_and_says_all_that_is_asked(hub: Path) -> None:
    import mlcroissant

    told = mlcroissant.Dataset(hub / "croissant.json")
    assert not told.metadata.issues.errors
    assert not told.metadata.issues.warnings
    raw = json.loads((hub / "croissant.json").read_text(encoding="utf-8"))
    assert raw["conformsTo"][1].endswith("/RAI/1.0")
    asked = {
        "dataCollection", "dataPreprocessingProtocol", "dataAnnotationProtocol", "dataUseCases", "dataLimitations",
        "dataBiases", "dataSocialImpact", "personalSensitiveInformation", "dataReleaseMaintenancePlan",
    }  # fmt: skip
    assert {key.removeprefix("rai:") for key in raw if key.startswith("rai:")} == asked
    assert all(len(raw[f"rai:{key}"]) > 80 for key in asked)
    files = {entry["contentUrl"]: entry["sha256"] for entry in raw["distribution"]}
    assert files == {name: sha256_of(hub / name) for name in files}
    assert set(files) == {path.relative_to(hub).as_posix() for path in hub.rglob("*.parquet")}


def test_a_record_can_be_read_through_it(hub: Path) -> None:
    import mlcroissant

    first = next(iter(mlcroissant.Dataset(hub / "croissant.json").records("rows/dev")))
    row = pq.read_table(hub / "rows" / "dev.parquet").to_pylist()[0]
    assert first["rows/dev/scenario_id"] == row["scenario_id"].encode()
    assert first["rows/dev/horizon"] == row["horizon"]


def test_fewer_than_a_hundred_files_each_under_its_licence(hub: Path) -> None:
    names = [path.relative_to(hub).as_posix() for path in hub.rglob("*") if path.is_file()]
    assert len(names) < 100
    sums = dict(reversed(line.split("  ")) for line in (hub / "SHA256SUMS").read_text(encoding="utf-8").splitlines())
    assert sums == {name: sha256_of(hub / name) for name in names if name != "SHA256SUMS"}
    for name in names:
        if name.endswith(".parquet"):
            assert "ODbL" in pq.read_schema(hub / name).metadata[b"licence"].decode(), name
    assert "Open Database License" in (hub / "ATTRIBUTION.md").read_text(encoding="utf-8")


def test_joined_scenes_are_those_of_the_types(hub: Path) -> None:
    for split in ("dev", "holdout"):
        joined = pq.read_table(hub / "scenes" / f"{split}.parquet")
        parts = [
            row
            for path in sorted((ROOT / "scenarios/scenes" / split).glob("*"))
            for row in pq.read_table(path).to_pylist()
        ]
        assert joined.to_pylist() == parts


def test_the_card_shows_its_tables_to_a_hub(hub: Path) -> None:
    _, head, text = (hub / "README.md").read_text(encoding="utf-8").split("---\n", 2)
    told = yaml.safe_load(head)
    assert (told["license"], told["pretty_name"]) == ("odbl", "tsbench")
    shown = {entry["path"] for config in told["configs"] for entry in config["data_files"]}
    assert {name for name in shown if not (hub / name).is_file()} == set()
    assert {"rows/dev.parquet", "rows/test.parquet", "rows/train.parquet", "rows/holdout.parquet"} <= shown
    rows = len(DataSet().table("dev"))
    assert f"| `rows/dev.parquet` | {rows} |" in text


def test_too_many_files_are_refused(hub: Path, tmp_path: Path) -> None:
    code = "import datetime, pathlib, runpy, sys; hub = runpy.run_path('packaging/hub.py'); "
    code += "hub['build'].__globals__['MOST_FILES'] = 82; "
    code += "hub['build'](pathlib.Path(sys.argv[1]), 'v9', datetime.date(2026, 1, 1))"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "hub")], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "join more of them" in done.stderr


def test_a_release_is_of_a_tag_that_its_code_has(tmp_path: Path) -> None:
    """Wheels, data, hub and sums out of a clone, whatever lies about beside what is tagged."""
    clone, out = tmp_path / "clone", tmp_path / "out"
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", str(clone)]
    subprocess.run(["git", "clone", "--quiet", "--depth", "1", f"file://{ROOT}", str(clone)], check=True)
    code = "import runpy, sys, pathlib; release = runpy.run_path('packaging/release.py'); "
    code += "release['build'](sys.argv[1], pathlib.Path(sys.argv[2]))"

    def build(tag: str) -> subprocess.CompletedProcess[str]:
        subprocess.run([*git, "tag", tag], check=True)
        (clone / "tsbench" / "not_mine.py").write_text("", encoding="utf-8")
        return subprocess.run(
            [sys.executable, "-c", code, tag, str(out)], cwd=clone, capture_output=True, text=True, check=False,
            env={"PYTHONPATH": str(clone), "PATH": "/usr/bin:/bin"},
        )  # fmt: skip

    wrong = build("v0.0.1")
    assert wrong.returncode == 1
    assert "v0.0.1: the code there says that it is 0.1.0" in wrong.stderr
    out.rmdir()
    done = build("v0.1.0")
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {"wheels", "data", "hub", "zenodo.json", "SHA256SUMS"}
    listing = subprocess.run(
        [sys.executable, "-m", "zipfile", "-l", str(next((out / "wheels").glob("tsbench-*.whl")))],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "tsbench/api/" in listing
    assert "not_mine" not in listing
    zenodo = json.loads((out / "zenodo.json").read_text(encoding="utf-8"))
    assert (zenodo["version"], zenodo["license"]) == ("0.1.0", "ODbL-1.0")
    assert len(zenodo["publication_date"]) == 10
    checked = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=out, check=False)
    assert checked.returncode == 0
