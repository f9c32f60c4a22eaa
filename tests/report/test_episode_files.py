"""Many episodes at once: what is selected, what is kept, what one bad trace costs, and the command."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import pytest
from PIL import Image as PilImage
from run_builders import episode, lost, make_run

from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, trace_path, write_trace
from tsbench.planners.registry import resolve
from tsbench.report.episode_files import Selection, episode_name, make_files, select_traces
from tsbench.scenarios.data_set import DataSet


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trace that was really driven, on a scene of the committed tables."""
    spec = next(row for row in DataSet.in_use().table("test") if row.scenario_type == "speed_limit")
    path = tmp_path_factory.mktemp("driven") / "trace.parquet"
    runner = EpisodeRunner(resolve("idm"))
    write_trace(path, runner.run(spec))
    runner.close()
    return path


@pytest.fixture
def run(tmp_path: Path, driven: Path) -> Path:
    """Two violations of idm and one of my.py:P, all with traces; one obedient episode without."""
    broken = lost() | {"violations": 1}
    rows = [
        episode("idm", 0, 0, 0, **broken),
        episode("idm", 1, 0, 0, **broken, outcome="collision"),
        episode("idm", 1, 1, 0, violations=0),
        episode("my.py:P", 0, 0, 0, **broken),
    ]
    folder = make_run(tmp_path / "run", rows, asked=3)
    for row in rows:
        if row["violations"]:
            path = trace_path(folder, row["planner"], row["scenario_id"])
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(driven, path)
    return folder


def names(run: Path, **asked: object) -> list[str]:
    return [episode_name(path) for path in select_traces(run, Selection(**asked)).traces]  # type: ignore[arg-type]


def test_a_selection_is_what_holds_all_of_it(run: Path) -> None:
    three = ["idm/speed_limit-m0-v0", "idm/yield-m0-v0", "my.py:P/yield-m0-v0"]
    assert names(run, failures=True) == three
    assert names(run, types=("speed",)) == ["idm/speed_limit-m0-v0"]
    assert names(run, planners=("idm",), outcomes=("arrived",)) == ["idm/yield-m0-v0"]
    assert select_traces(run, Selection(planners=("idm",))).untraced == 1
    assert not Selection()
    for asked, words in (
        ({"planners": ("fly",)}, "--planner fly: there are idm, my.py:P"),
        ({"outcomes": ("fly",)}, "--outcome fly: there are arrived"),
        ({"types": ("fly",)}, "--types fly: no such type"),
        ({"outcomes": ("off_road",)}, "none of its 4 episodes is selected"),
        ({"failures": False, "outcomes": ("arrived",), "types": ("speed",)}, "none of the 1 selected"),
    ):
        with pytest.raises(InputError, match=words):
            names(run, **asked)


def copy_spec(trace: Trace, path: Path) -> None:
    """A maker for worker processes: text instead of a film."""
    with replacing(path) as part:
        part.write_text(f"{os.getpid()} {len(trace.snapshots)}")


def test_what_is_there_is_kept_and_a_torn_trace_costs_itself(driven: Path, tmp_path: Path) -> None:
    traces = [Path(shutil.copy(driven, tmp_path / f"{k}.parquet")) for k in range(4)]
    traces[3].write_bytes(driven.read_bytes()[:-100])
    files = {trace: tmp_path / "out" / f"{trace.stem}.txt" for trace in traces}
    seen: list[tuple[int, int]] = []
    tally = make_files(files, copy_spec, 2, lambda *at: seen.append(at))
    assert (tally.made, tally.kept, [path for path, _ in tally.failed]) == (3, 0, [traces[3]])
    assert "cannot be read as a trace" in tally.failed[0][1]
    assert seen == [(k, 4) for k in range(5)]
    assert tally.driven_s > 3.0
    before = files[traces[0]].read_text()
    assert not before.startswith(f"{os.getpid()} ")

    os.utime(traces[1], (2e9, 2e9))  # driven anew since
    del files[traces[3]]
    again = make_files(files, copy_spec, 1, lambda *_: None)
    assert (again.made, again.kept, again.failed) == (1, 2, ())
    assert files[traces[0]].read_text() == before
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["0.txt", "1.txt", "2.txt"]


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    def write_half() -> None:
        with replacing(tmp_path / "new" / "a") as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert list((tmp_path / "new").iterdir()) == []
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(InputError, match="file: File exists"),
        io_errors_as_input_errors(tmp_path / "file" / "a"),
        replacing(tmp_path / "file" / "a"),
    ):
        pass


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["render", *map(str, arguments)])
    told = capsys.readouterr()
    return int(ended.value.code or 0), told.out, told.err


@pytest.mark.slow
def test_the_command_draws_all_violations(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace_path(run, "my.py:P", "yield-m0-v0").write_bytes(b"torn")
    code, out, _ = command(capsys, run, "--failures", "--format", "mp4", "--workers", "2")
    assert code == 1
    assert "my.py:P/yield-m0-v0: " in out
    assert "2 mp4 files made, 0 kept, 1 failed" in out
    films = sorted((run / "pictures").glob("*/*.mp4"))
    assert [f.stem for f in films] == ["speed_limit-m0-v0", "yield-m0-v0"]
    assert cv2.VideoCapture(str(films[0])).get(cv2.CAP_PROP_FRAME_COUNT) > 50
    code, out, _ = command(capsys, run, "--types", "yield", "--planner", "idm", "--format", "mp4")
    assert (code, out.splitlines()[0]) == (0, "0 mp4 files made, 1 kept, 0 failed")
    code, out, _ = command(capsys, run, "--types", "speed", "--country", "de", "--out", run / "de")
    assert code == 0
    assert PilImage.open(run / "de" / "idm" / "speed_limit-m0-v0.de.png").format == "PNG"
    assert "1 selected episodes have no trace" in out


def test_wrong_usage_is_one_line(run: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for arguments, words in (
        ((run,), "name one EPISODE"),
        ((run, "yield-m0-v0", "--failures"), "name one EPISODE"),
        ((run, "--failures", "--time", 1), "--time chooses the moment of one EPISODE"),
        ((tmp_path, "--failures"), "no run folder"),
    ):
        code, out, err = command(capsys, *arguments)
        assert (code, out) == (2, "")
        assert words in err
        assert err.count("\n") == 1
