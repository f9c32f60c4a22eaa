"""The wheels, as a user has them: what is in them, and both commands in an empty environment and an empty folder."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections import Counter
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tsbench.signs.catalog import load_catalog

ROOT = Path(__file__).resolve().parents[2]
MEGABYTE = 1_000_000
pytestmark = pytest.mark.slow


def done(*command: object, cwd: Path, **env: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end without what this environment says about Python and data."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "TSBENCH", "VIRTUAL_ENV"))}
    return subprocess.run(
        [str(part) for part in command], cwd=cwd, env={**kept, **env}, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both wheels, built from this clone as `make package` does."""
    folder = tmp_path_factory.mktemp("dist")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", folder)
    built = done(sys.executable, "-m", "pip", "wheel", *options, ROOT, ROOT / "packaging/tsbench-data", cwd=ROOT)
    assert built.returncode == 0, built.stderr
    return folder


def megabytes(what: str) -> float:
    """What docs/install.md says of a size."""
    page = (ROOT / "docs/install.md").read_text(encoding="utf-8")
    (size,) = re.findall(rf"^\| {re.escape(what)} \| ([\d.]+) MB \|", page, re.M)
    return float(size)


def names_in(wheels: Path, pattern: str) -> list[str]:
    (wheel,) = wheels.glob(pattern)
    return [name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name]


def test_the_code_comes_with_catalogue_and_weights_and_nothing_else(wheels: Path) -> None:
    inside = set(names_in(wheels, "tsbench-*.whl"))
    tracked = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "tsbench", "sign_catalog"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.splitlines()  # fmt: skip
    assert inside == {f"tsbench/{name}" if name.startswith("sign_catalog") else name for name in tracked}
    (wheel,) = wheels.glob("tsbench-*.whl")
    assert wheel.stat().st_size / MEGABYTE == pytest.approx(megabytes("wheel `tsbench`"), rel=0.03)


def test_the_data_are_those_of_the_dev_and_test_splits(wheels: Path) -> None:
    inside = names_in(wheels, "tsbench_data-*.whl")
    asked = json.loads((ROOT / "tsbench/core/data_manifest.json").read_text(encoding="utf-8"))["sets"]["test"]["files"]
    runs = [path.parent for path in (ROOT / "results").glob("*/run.json")]
    results = {f"results/{run.name}/{path.name}" for run in runs for path in run.iterdir() if path.suffix != ".md"}
    data = {name for name, *_ in asked} | results | {"__init__.py"}
    assert set(inside) == {f"tsbench_data/{name}" for name in data}
    assert "results/plant2-ft/run.json" in results
    kinds = Counter("/".join(name.split("/")[1:-1]) for name in inside if "/results/" not in name)
    single, double = len(load_catalog().types), len(load_catalog().combined)
    assert kinds == {
        "": 1, "scenarios": 8, "scenarios/recipes": single + double,
        "scenarios/scenes/dev": single, "scenarios/scenes/test": single,
        "scenarios/scenes/two-signs": double, "scenarios/scenes/two-signs-dev": double,
        "cities": 4, "sumo_nets": 3, "sumo_nets/netconvert": 4,
    }  # fmt: skip
    assert "tsbench_data/sumo_nets/ATTRIBUTION.md" in inside
    (wheel,) = wheels.glob("tsbench_data-*.whl")
    assert wheel.stat().st_size / MEGABYTE == pytest.approx(megabytes("wheel `tsbench_data`"), rel=0.03)


def test_data_that_are_not_the_manifests_are_not_packed(tmp_path: Path) -> None:
    clone = tmp_path / "clone"
    shutil.copytree(ROOT / "packaging", clone / "packaging", ignore=shutil.ignore_patterns("build", "__pycache__"))
    for name in ("tsbench/__init__.py", "tsbench/core/data_manifest.json"):
        (clone / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, clone / name)
    for name in ("scenarios", "sumo_nets"):
        (clone / name).mkdir()
    shutil.copytree(ROOT / "cities", clone / "cities", ignore=shutil.ignore_patterns("data"))
    (clone / "scenarios/build_report.json").write_bytes((ROOT / "scenarios/build_report.json").read_bytes() + b" ")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", tmp_path)
    built = done(sys.executable, "-m", "pip", "wheel", *options, clone / "packaging/tsbench-data", cwd=clone)
    assert built.returncode != 0
    assert "scenarios/build_report.json: is not the file that the manifest names" in built.stderr


@pytest.fixture(scope="module")
def user(wheels: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of a new environment with both wheels and what they ask for, by the lock file."""
    folder = tmp_path_factory.mktemp("user")
    made = done(sys.executable, "-m", "venv", folder / "env", cwd=folder)
    assert made.returncode == 0, made.stdout
    python = folder / "env/bin/python"
    pinned = done(sys.executable, "-m", "pip", "--version", cwd=folder).stdout.split()[1]
    got = done(python, "-m", "pip", "install", f"pip=={pinned}", cwd=folder)
    if got.returncode and "No matching distribution" in got.stdout + got.stderr:
        pytest.skip("the package index cannot be reached")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (folder / "asked.txt").write_text("\n".join(project["dependencies"]), encoding="utf-8")
    lock = ("--require-hashes", "--constraint", ROOT / "requirements.lock")
    got = done(python, "-m", "pip", "install", "--no-compile", *lock, "--requirement", folder / "asked.txt", cwd=folder)
    assert got.returncode == 0, got.stderr
    # Without an index: nothing but what was asked for is needed.
    got = done(python, "-m", "pip", "install", "--no-index", *sorted(wheels.glob("*.whl")), cwd=folder)
    assert got.returncode == 0, got.stderr
    yield folder / "env/bin"
    shutil.rmtree(folder)


@pytest.mark.timeout(400)
def test_a_run_and_the_doctor_in_an_empty_folder(user: Path, tmp_path: Path) -> None:
    home = str(tmp_path / "home")
    here = tmp_path / "empty"
    here.mkdir()
    options = ("--planner", "idm", "--split", "dev", "--variants", "0", "--limit", "4", "--workers", "1")
    ran = done(user / "tsbench", "run", *options, "--out", "run", cwd=here, HOME=home)
    assert ran.returncode == 0, ran.stderr
    assert "4 of 4 episodes finished, 0 with an error outcome" in ran.stdout
    program = ("-c", "from tsbench.cli import main; main()")
    mine = done(sys.executable, *program, "run", *options, "--out", "clone", cwd=here, PYTHONPATH=str(ROOT))
    assert mine.returncode == 0, mine.stderr
    table, other = (pq.read_table(here / name / "episodes.parquet") for name in ("run", "clone"))
    assert table.num_rows == 4
    assert table.equals(other)
    seen = done(user / "tsbench", "doctor", cwd=here, HOME=home)
    assert seen.returncode == 0, seen.stdout
    assert "nothing is in the way" in seen.stdout
    rows = pq.read_metadata(ROOT / "scenarios/test.parquet").num_rows
    assert f"test.parquet: {rows} scenarios, all " in seen.stdout
    assert str(ROOT) not in seen.stdout
    for extra in ("report", "make", "learn"):
        assert f"pip install 'tsbench[{extra}]'" in seen.stdout


@pytest.mark.timeout(400)
def test_what_does_not_come_with_the_wheels_is_named_and_fetched(user: Path, tmp_path: Path) -> None:
    home, here = str(tmp_path / "home"), tmp_path / "empty"
    here.mkdir()

    def told(*arguments: str) -> str:
        ended = done(user / "tsbench", *arguments, cwd=here, HOME=home)
        assert ended.returncode == 2, ended.stdout
        assert ended.stderr.count("\n") == 1
        return ended.stderr

    options = ("run", "--planner", "idm", "--split", "train", "--limit", "1", "--workers", "1", "--out", "run")
    assert "tsbench data fetch --from DIR|URL train" in told(*options)
    assert "pip install 'tsbench[report]'" in told("report", "run")
    assert "set TSBENCH_DATA to a clone" in told("scenarios", "certify")
    came = done(user / "tsbench", "data", "fetch", "--from", ROOT, "train", cwd=here, HOME=home)
    assert came.returncode == 0, came.stderr
    ran = done(user / "tsbench", *options, cwd=here, HOME=home)
    assert "2 of 2 episodes finished, 0 with an error outcome" in ran.stdout, ran.stderr
