"""The command line as a whole: fast help, one-line errors, and `run` and `rescore` on real scenes."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import click
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import commands, in_process, refused
from patience import HANG_S

from tsbench.cli import cli
from tsbench.run.log.record import EPISODES

# pandas takes longer to import than an episode to drive, and Arrow imports it where it is asked for a plain value.
MAIN = """
import sys
from tsbench.cli import main
try:
    main()
finally:
    assert "pandas" not in sys.modules
"""


def tsbench(*arguments: str, cwd: Path | None = None, expect: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *arguments], cwd=cwd, text=True, capture_output=True, timeout=HANG_S, check=False
    )
    assert done.returncode == expect, done.stderr
    assert "Traceback" not in done.stderr
    return done


def test_help_names_all_commands_in_three_groups() -> None:
    parts = re.split(r"^(\S[^\n]*):$", tsbench("--help").stdout, flags=re.M)[1:]
    groups = {title: re.findall(r"^  (\w+)  ", body, re.M) for title, body in zip(parts[::2], parts[1::2], strict=True)}
    assert list(groups) == ["Options", "Use", "Bring a planner of your own", "Make the data"]
    assert groups["Use"][:3] == ["run", "campaign", "compare"]
    assert groups["Bring a planner of your own"] == ["planners", "debug", "train", "oracle", "bench"]
    assert {"data", "city", "maps", "scenarios"} <= set(groups["Make the data"])
    named = [name for names in groups.values() for name in names]
    assert sorted(named) == sorted(cli.list_commands(click.Context(cli)))


def test_an_option_is_one_thing_in_all_commands() -> None:
    found: dict[str, dict[str, str]] = {}
    for path, command in commands(cli):
        for one in command.params:
            if isinstance(one, click.Option):
                assert len(one.opts) == 1, (path, one.opts)
                for name in (*one.opts, *one.secondary_opts):
                    assert re.fullmatch(r"--[a-z]+(-[a-z]+)*", name), path
                found.setdefault(one.opts[0], {})[path] = one.type.name
    # What is written may be a file or a folder; `data fetch` takes addresses too; one command has two planners only.
    # `failures --by` names a column, and its `--json` is for a pipe.
    apart = {name: kinds for name, kinds in found.items() if len(set(kinds.values())) > 1}
    assert set(apart) == {"--out", "--from", "--planner", "--by", "--json"}, apart
    assert len(found) > 50


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frobnicate"], "No such command 'frobnicate'. (see"),
        (["compaire"], "No such command 'compaire' (did you mean compare?)."),
        (["run", "--split", "test"], "Missing option '--planner'"),
        (["run", "--planner", "idm"], "Missing option '--split'"),
        (["run", "--planner", "idm", "--split", "exam"], "Invalid value for '--split'"),
        (["run", "--planner", "idm", "--split", "test", "--limit", "0"], "Invalid value for '--limit'"),
        (["run", "--planner", "idm", "--split", "test", "--types", "speling"], "--types speling: no such type"),
        (
            ["run", "--planner", "idm", "--split", "dev", "--types", " , "],
            "Invalid value for '--types': names no type; leave it out for all",
        ),
        (["run", "--planner", "idm", "--split", "dev", "--out", ""], "'--out': is empty: name a file or a folder"),
        (
            ["run", "--planner", "idm", "--split", "dev", "--city", "atlantis"],
            "--city atlantis: no such city; there are andorra, krems, moscow, north-bayreuth\n",
        ),
        (
            ["run", "--planner", "idm", "--split", "dev", "--city", "Moscow"],
            "a city's name is of a-z, 0-9 and '-'; there are andorra, krems, moscow, north-bayreuth\n",
        ),
        (["run", "--planner", "idn", "--split", "test", "--limit", "1"], "planner 'idn': no such planner"),
        (["rescore", "no/such/run"], "no/such/run: no run folder"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert words in refused(in_process(arguments[0], capsys), *arguments[1:])
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four nominal scenarios driven by idm, every tick kept."""
    folder = tmp_path_factory.mktemp("real")
    run = ["run", "--planner", "idm", "--split", "dev", "--variants", "0", "--limit", "4", "--trace", "all"]
    done = tsbench(*run, "--out", "one", "--workers", "1", cwd=folder)
    assert "4 of 4 episodes finished, 0 with an error outcome" in done.stdout
    with pytest.raises(SystemExit):
        cli([*run, "--out", str(folder / "two"), "--workers", "2"])
    return folder


def test_real_scenes_with_one_and_two_workers(real: Path) -> None:
    for name in ("episodes.parquet", "violations.parquet"):
        assert (real / "one" / name).read_bytes() == (real / "two" / name).read_bytes()
    assert len(list((real / "one" / "traces").rglob("*.parquet"))) == 4


def test_rescore_finds_what_was_changed(
    real: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(real)
    out, _ = in_process("rescore", capsys)("one")
    assert out == "one: 4 traces judged again, 0 episodes without a trace, disagreements: 0\n"
    path = real / "two" / "episodes.parquet"
    table = pq.ParquetFile(path).read()
    rows = table.to_pylist()
    changed = rows[0]["scenario_id"]
    rows[0]["sign_compliant"] = not rows[0]["sign_compliant"]
    rows[0]["comfort"] = 0.123
    pq.write_table(pa.Table.from_pylist(rows, schema=EPISODES.with_metadata(table.schema.metadata)), path)
    out, _ = in_process("rescore", capsys)("two", expect=1)
    assert f"idm {changed}: sign_compliant is" in out
    assert f"idm {changed}: comfort is 0.123, by its trace" in out
    assert "summary.json: differs from the aggregates" in out
