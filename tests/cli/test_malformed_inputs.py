"""Malformed files and folders of every kind, for every command that reads one: one line and exit code 2."""

from __future__ import annotations

import copy
import gzip
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from command_line import one_line
from data_folder import in_force
from run_builders import episodes, make_run

from tsbench.cli import main
from tsbench.core import parquet, xmlfile
from tsbench.core.errors import InputError
from tsbench.core.paths import data_root
from tsbench.make.scenes.overview import build_report
from tsbench.make.scenes.recipe import load_recipe, recipes_folder
from tsbench.run.log.manifest import read_manifest
from tsbench.signs.catalog import load_catalog

# What may stand where a file should: bytes, or something else than a file.
CONTENTS: dict[str, bytes] = {
    "empty": b"",
    "not UTF-8": b"\xff\xfe\x00schema: 1",
    "a NUL": b"schema: 1\x00",
    "deep list": b"[" * 100_000,
    "deep mapping": b'{"a":' * 100_000,
    "endless number": b"9" * 10_000,
    "infinity": b"1e999",
    "null": b"null",
    "number": b"7",
    "half a character": b'"\\ud800"',
    "XML": b"<osm version='0.6'><way id='1'><nd ref='1'/></osm>",
    "entities": b'<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><net>&c;</net>',
    "gzip cut short": gzip.compress(b"<net/>" * 1000)[:20],
    "Parquet cut short": b"PAR1" + b"\x15" * 100,
}
THINGS = (*CONTENTS, "truncated", "directory", "link to itself", "dangling link", "no right to read")


def spoil(path: Path, thing: str) -> None:
    """Put something malformed in a good file's place."""
    good = path.read_bytes() if path.is_file() else b""
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    if thing == "directory":
        path.mkdir()
    elif thing == "link to itself":
        path.symlink_to(path)
    elif thing == "dangling link":
        path.symlink_to(path.with_name("nowhere"))
    else:
        path.write_bytes(good[: len(good) // 2] if thing == "truncated" else CONTENTS.get(thing, good))
    if thing == "no right to read":
        if os.geteuid() == 0:
            pytest.skip("root may read everything")
        path.chmod(0)


Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def tsbench(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """A command in this process: exit code, output, errors. Anything but an exit is a traceback, and fails the test."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        told = capsys.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, told.out, told.err

    return command


def assert_refused(told: tuple[int, str, str], name: str) -> None:
    """Exit code 2, and one line that names the file."""
    code, _, err = told
    lines = [line for line in err.splitlines() if line and not line.startswith("note: ")]
    assert code == 2, told
    assert len(lines) == 1, err
    assert lines[0].startswith("error: ")
    assert name in lines[0]
    assert len(lines[0]) < 600


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("made") / "run", episodes("idm", maps=1, variants=2))


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    """A copy of a good run."""
    return Path(shutil.copytree(made, tmp_path / "run"))


READERS = {
    "rescore": ["rescore", "run"],
    "report": ["report", "run", "--out", "page.html"],
    "compare": ["compare", "run:idm", "run:idm"],
    "analyse": ["analyse", "main", "run"],
    "render": ["render", "run", "yield-m0-v0"],
    "export": ["export", "run", "yield-m0-v0", "--format", "commonroad"],
    "oracle": ["oracle", "select", "run"],
    "continue": ["run", "--planner", "idm", "--split", "dev", "--limit", "1", "--out", "run"],
}


@pytest.mark.parametrize("thing", THINGS)
def test_a_manifest_that_is_none(run: Path, tsbench: Command, thing: str) -> None:
    spoil(run / "run.json", thing)
    for arguments in READERS.values():
        assert_refused(tsbench(*arguments), "run")


@pytest.mark.parametrize("table", ["episodes.parquet", "violations.parquet"])
@pytest.mark.parametrize("thing", THINGS)
def test_a_table_that_is_none(run: Path, tsbench: Command, thing: str, table: str) -> None:
    spoil(run / table, thing)
    for name in ("rescore", "compare", "report"):
        assert_refused(tsbench(*READERS[name]), table)


VALUES: list[Any] = [
    None, True, -1, 7, 1.5, 10**400, float("inf"), "", "x", "../x", "\x00", "\ud800", [], [[]], [1], [None], {},
    {"a": 1}, {"name": []},
]  # fmt: skip


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where in a manifest something stands."""
    yield at
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from places(value[key], (*at, key))


def altered(manifest: dict[str, Any], at: tuple[Any, ...], value: Any) -> Any:
    if not at:
        return value
    found = copy.deepcopy(manifest)
    inner = found
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return found


def problem_of(run: Path) -> str | None:
    """What reading its manifest says against it."""
    try:
        read_manifest(run)
    except InputError as problem:
        return str(problem)
    return None


def test_an_ill_typed_manifest(run: Path, tsbench: Command) -> None:
    """Every part of a manifest in turn is something else: it is refused, or every command can live with it."""
    good = json.loads((run / "run.json").read_text())
    refused, accepted, compared = 0, 0, set()
    for at in places(good):
        for value in VALUES:
            (run / "run.json").write_text(json.dumps(altered(good, at, value)))
            problem = problem_of(run)
            if problem is not None:
                assert "\n" not in problem
                assert "run.json: " in problem
                refused += 1
                continue
            accepted += 1
            if at and at[0] in ("planners", "effective") and (at, type(value)) not in compared:
                compared.add((at, type(value)))
                code, _, err = tsbench(*READERS["compare"])
                assert code in (0, 1, 2), (at, value, err)
    assert refused > 300
    assert accepted > 20


@pytest.mark.parametrize("thing", THINGS)
def test_a_recipe_that_is_none(tmp_path: Path, thing: str) -> None:
    path = Path(shutil.copy(recipes_folder() / "yield.yaml", tmp_path))
    spoil(path, thing)
    with one_line(str(path)):
        load_recipe("yield", load_catalog(), tmp_path)


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize("suffix", [".osm", ".osm.gz", ".osm.pbf"])
def test_an_extract_that_is_none(tmp_path: Path, tsbench: Command, thing: str, suffix: str) -> None:
    path = tmp_path / f"town{suffix}"
    path.write_bytes(b"<osm version='0.6'><node id='1' lat='999' lon='1'/></osm>")
    spoil(path, thing)
    assert_refused(tsbench("maps", "convert", path, "--out", "town.net.xml"), "town")


def test_an_extract_with_a_place_that_is_none(tmp_path: Path, tsbench: Command) -> None:
    (tmp_path / "town.osm").write_text(
        "<osm version='0.6'><node id='1'><tag k='highway' v='traffic_signals'/></node></osm>"
    )
    assert_refused(tsbench("maps", "convert", "town.osm", "--out", "town.net.xml"), "town.osm")


@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize(
    ("file", "arguments"),
    [
        ("scenarios/test.parquet", ["run", "--planner", "idm", "--split", "test", "--limit", "1"]),
        ("sumo_nets/pool.parquet", ["maps", "stats"]),
        ("sign_catalog/rules/stop.yaml", ["signs", "list"]),
    ],
)
def test_data_that_is_none(tmp_path: Path, tsbench: Command, thing: str, file: str, arguments: list[str]) -> None:
    root = data_root()
    if not (root / file).exists():
        pytest.skip(f"no {file}")
    shutil.copytree(root / "sign_catalog", tmp_path / "data" / "sign_catalog")
    for name in ("scenarios", "sumo_nets"):
        (tmp_path / "data" / name).mkdir(parents=True)
        for path in (root / name).iterdir():
            (tmp_path / "data" / name / path.name).symlink_to(path)
    path = tmp_path / "data" / file
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(content)
    spoil(path, thing)
    with in_force(tmp_path / "data"):
        assert_refused(tsbench(*arguments), Path(file).name)


@pytest.mark.parametrize("thing", THINGS)
def test_a_build_report_that_is_none(tmp_path: Path, thing: str) -> None:
    spoil(tmp_path / "build_report.json", thing)
    with pytest.raises(InputError, match=r"build_report\.json: "):
        build_report(tmp_path / "build_report.json")


def test_a_table_that_says_it_is_endless(run: Path, tsbench: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parquet, "_MOST_ROWS", 3)
    assert_refused(tsbench(*READERS["compare"]), "episodes.parquet: 4 rows, 0 MiB unpacked: too large")


@pytest.mark.parametrize("thing", THINGS)
def test_a_planner_that_is_none(tmp_path: Path, tsbench: Command, thing: str) -> None:
    (tmp_path / "planner.py").write_text("class P:\n    def reset(self, context): ...\n    def act(self, o): ...\n")
    spoil(tmp_path / "planner.py", thing)
    assert_refused(tsbench("planners", "check", "planner.py:P"), "planner.py")


def test_what_unpacks_to_too_much_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xmlfile, "_MOST_BYTES", 1 << 20)
    path = tmp_path / "large.net.xml.gz"
    path.write_bytes(gzip.compress(b" " * ((1 << 20) + 1)))
    with pytest.raises(InputError, match=r"large\.net\.xml\.gz: more than 1 MiB unpacked: too large for a network"):
        xmlfile.read_plain(path, "network")
    path.write_bytes(gzip.compress(b" " * (1 << 20)))
    assert len(xmlfile.read_plain(path, "network")) == 1 << 20
