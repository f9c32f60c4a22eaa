"""Many episodes at once: what is selected, what is kept, what one bad trace costs, and the command."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import pyarrow as pa
import pytest
from command_line import in_process, refused
from PIL import Image as PilImage
from run_builders import episode, lost, make_run

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.files import replacing
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, read_trace, trace_path, write_trace
from tsbench.planners.registry import resolve
from tsbench.report.episode_files import FileKind, Selection, make_one, make_selected, select_episodes
from tsbench.report.scene_pictures import picture_kind
from tsbench.run.log.read import read_run
from tsbench.run.rescore import rescore
from tsbench.run.run_traces import Traces
from tsbench.scenarios.data_set import DataSet
from tsbench.sim.scene import Scene


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trace that was really driven, on a scene of the committed tables."""
    spec = next(row for row in DataSet().table("test") if row.scenario_type == "speed_limit")
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
    return ["/".join(key) for key in select_episodes(read_run(run), Selection(**asked))]  # type: ignore[arg-type]


def test_a_selection_is_what_holds_all_of_it(run: Path) -> None:
    three = ["idm/speed_limit-m0-v0", "idm/yield-m0-v0", "my.py:P/yield-m0-v0"]
    assert names(run, failures=True) == three
    assert names(run, types=("speed",)) == ["idm/speed_limit-m0-v0", "idm/speed_limit-m1-v0"]
    assert names(run, planners=("idm",), outcomes=("arrived",)) == ["idm/speed_limit-m1-v0", "idm/yield-m0-v0"]
    assert len(names(run, planners=("idm",))) == 3
    assert not Selection()
    for asked, words in (
        ({"planners": ("fly",)}, "--planner fly: there are idm, my.py:P"),
        ({"outcomes": ("fly",)}, "--outcome fly: there are arrived"),
        ({"types": ("fly",)}, "--types fly: no such type"),
        ({"outcomes": ("off_road",)}, "none of its 4 episodes is selected"),
    ):
        with pytest.raises(InputError, match=words):
            names(run, **asked)


def copy_spec(trace: Trace, scene: Scene, path: Path) -> None:
    """A maker for worker processes: text instead of a film."""
    assert scene.target_signs[0].code == trace.spec.sign_code
    with replacing(path) as part:
        part.write_text(f"{os.getpid()} {len(trace.snapshots)}")


def test_what_is_there_is_kept_and_a_torn_trace_costs_itself(run: Path, driven: Path, tmp_path: Path) -> None:
    torn = trace_path(run, "my.py:P", "yield-m0-v0")
    torn.write_bytes(driven.read_bytes()[:-100])
    kind, seen = FileKind("texts", ".txt", copy_spec), list[tuple[int, int]]()
    tally = make_selected(run, Selection(failures=True), kind, None, 2, lambda *at: seen.append(at))
    assert (tally.made, tally.kept, [name for name, _ in tally.failed]) == (2, 0, ["my.py:P/yield-m0-v0"])
    assert "cannot be read as a trace" in tally.failed[0][1]
    assert seen == [(k, 3) for k in range(4)]
    assert tally.driven_s > 3.0
    one, other = (kind.path(run / "texts", ("idm", name)) for name in ("speed_limit-m0-v0", "yield-m0-v0"))
    before = one.read_text()
    assert not before.startswith(f"{os.getpid()} ")

    os.utime(trace_path(run, "idm", "yield-m0-v0"), (2e9, 2e9))  # driven anew since
    again = make_selected(run, Selection(planners=("idm",), failures=True), kind, None, 1, lambda *_: None)
    assert (again.made, again.kept, again.failed) == (1, 1, ())
    assert one.read_text() == before
    assert sorted(p.name for p in other.parent.iterdir()) == [one.name, other.name]


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run over one pair of idm, which fails the signed half alone: of that it kept the trace."""
    folder = tmp_path_factory.mktemp("pair") / "run"
    tsbench.evaluate("idm", split="dev", types="yield", limit=2, workers=1, out=folder)
    return folder


def test_an_episode_without_a_trace_is_driven_again(pair: Path) -> None:
    traces = Traces(read_run(pair))
    rows = {row["half"]: row for row in traces.run.episodes.to_pylist()}
    kept, other = (trace_path(pair, "idm", rows[half]["scenario_id"]) for half in ("signed", "contrast"))
    assert kept.is_file()
    assert not other.is_file()
    as_kept = read_trace(kept)
    kept.unlink()
    assert traces.read("idm", rows["signed"]["scenario_id"]).against == as_kept.against
    beside = traces.of_other_half(rows["signed"])
    assert (beside.spec.half, str(beside.outcome)) == ("contrast", rows["contrast"]["outcome"])
    assert other.is_file()
    assert rescore(pair).disagreements == ()
    for half, width in (("signed", 2800), ("contrast", 1400)):
        picture = make_one(pair, rows[half]["scenario_id"], picture_kind("png", None), None)
        assert PilImage.open(picture).size == (width, 1050)


def test_an_episode_that_is_another_now_is_refused(pair: Path, tmp_path: Path) -> None:
    run = read_run(pair)
    row = run.episodes.to_pylist()[0]
    changed = [other | ({"duration_s": 1.5} if other == row else {}) for other in run.episodes.to_pylist()]
    for which, words in (
        ({"episodes": pa.Table.from_pylist(changed, run.episodes.schema)}, "duration_s was 1.5, now "),
        ({"manifest": run.manifest | {"contract": "0" * 64}}, "another contract than this tsbench"),
        ({"manifest": run.manifest | {"isolation": {}}}, "planners were isolated"),
    ):
        traces = Traces(replace(run, path=tmp_path, **which))  # type: ignore[arg-type]
        with pytest.raises(InputError, match=words):
            traces.read("idm", row["scenario_id"])
    assert not (tmp_path / "traces").exists()


@pytest.mark.slow
def test_the_command_draws_all_violations(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace_path(run, "my.py:P", "yield-m0-v0").write_bytes(b"torn")
    render = in_process("render", capsys)
    out, _ = render(str(run), "--failures", "--format", "mp4", "--workers", "2", expect=1)
    assert "my.py:P/yield-m0-v0: " in out
    assert "2 mp4 files made, 0 kept, 1 failed" in out
    films = sorted((run / "pictures").glob("*/*.mp4"))
    assert [f.stem for f in films] == ["speed_limit-m0-v0", "yield-m0-v0"]
    assert cv2.VideoCapture(str(films[0])).get(cv2.CAP_PROP_FRAME_COUNT) > 50
    out, _ = render(str(run), "--types", "yield", "--planner", "idm", "--format", "mp4")
    assert out.splitlines()[0] == "0 mp4 files made, 1 kept, 0 failed"
    render(str(run), "--failures", "--types", "speed", "--country", "de", "--out", str(run / "de"))
    assert PilImage.open(run / "de" / "idm" / "speed_limit-m0-v0.de.png").format == "PNG"


def test_wrong_usage_is_one_line(run: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for arguments, words in (
        ((run,), "name one EPISODE"),
        ((run, "yield-m0-v0", "--failures"), "name one EPISODE"),
        ((run, "--failures", "--time", 1), "--time chooses the moment of one EPISODE"),
        ((tmp_path, "--failures"), "no run folder"),
    ):
        assert words in refused(in_process("render", capsys), *map(str, arguments))
