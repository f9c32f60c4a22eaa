"""An episode begins with nothing: what a driver learned in one half of a pair does not reach the other."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import tsbench
from tsbench.board.isolation.isolated_loading import describe as describe_isolated
from tsbench.core.errors import InputError
from tsbench.episode.trace import read_trace, trace_path
from tsbench.run.log.manifest import marks_of, read_manifest
from tsbench.run.planner_info import describe

DRIVERS = Path(__file__).parents[2] / "helpers" / "remembering.py"
ALL = ("InObject", "InClass", "InModule", "InProcess", "InFile", "InSharedMemory", "Keeps")
FIRST, SECOND = 0.2, 0.4


@pytest.fixture
def drivers(tmp_path: Path) -> str:
    """The file of the drivers under a name of its own: what they leave behind bears it."""
    folder = tmp_path / tmp_path.name
    folder.mkdir()
    return str(shutil.copy(DRIVERS, folder / f"{tmp_path.name}_drivers.py"))


def driven(file: str, names: tuple[str, ...], out: Path, *, isolate: bool = False) -> dict[str, list[float]]:
    """The acceleration that each driver asked for in the two halves of one pair, sorted; one worker drives both."""
    made = tsbench.evaluate(
        [f"{file}:{name}" for name in names], split="dev", types=["speed_limit"], limit=2, workers=1, trace="all",
        isolate=isolate, out=out,
    )  # fmt: skip
    assert len(made.episodes) == 2 * len(names)
    assert not made.episodes.error.notna().any()
    found: dict[str, list[float]] = {name: [] for name in names}
    for row in made.episodes.itertuples():
        trace = read_trace(trace_path(out, row.planner, row.scenario_id))
        found[row.planner].append(float(trace.commands[0, 0]))
    return {name: sorted(commands) for name, commands in found.items()}


@pytest.mark.parametrize(
    ("names", "isolate"), [(("InObject", "InModule", "InProcess"), False), (("InProcess", "InFile"), True)]
)
def test_what_a_driver_keeps_does_not_reach_the_next_episode(
    drivers: str, tmp_path: Path, names: tuple[str, ...], isolate: bool
) -> None:
    """In its process; an isolated driver keeps no file either."""
    assert driven(drivers, names, tmp_path / "run", isolate=isolate) == {name: [FIRST, FIRST] for name in names}


def test_who_can_remember_is_marked(drivers: str, tmp_path: Path) -> None:
    """By its own word, or because its constructor made what a fork does not separate."""
    names = ("InSharedMemory", "Keeps")
    assert driven(drivers, names, tmp_path / "run") == {name: [FIRST, SECOND] for name in names}
    manifest = read_manifest(tmp_path / "run")
    assert [planner["may_remember"] for planner in manifest["planners"]] == [True, True]
    assert marks_of(manifest) == dict.fromkeys(names, "may remember")


@pytest.mark.parametrize("name", ALL)
def test_the_mark_is_the_same_isolated(drivers: str, name: str) -> None:
    remembers = name in ("InSharedMemory", "Keeps")
    assert describe(f"{drivers}:{name}").may_remember is remembers
    assert describe_isolated(f"{drivers}:{name}").planner.may_remember is remembers


def test_a_file_outside_a_sandbox_is_not_wiped(drivers: str, tmp_path: Path) -> None:
    """docs/planners.md says so: only `--isolate` and `verify` hold it off."""
    (commands,) = driven(drivers, ("InFile",), tmp_path / "run").values()
    assert SECOND in commands


PLANNER = f"{DRIVERS}:Steady"


def devices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, device: str) -> set[str]:
    """The devices on which workers have loaded the planner's network."""
    log = tmp_path / f"{name}.log"
    monkeypatch.setenv("DEVICES_LOG", str(log))
    tsbench.evaluate(
        [PLANNER], split="dev", types=("yield",), limit=2, workers=1, trace="none", device=device, out=tmp_path / name
    )
    return {*log.read_text().split()}


def test_a_network_runs_on_the_device_that_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert devices(tmp_path, monkeypatch, "cpu", "cpu") == {"cpu"}
    assert devices(tmp_path, monkeypatch, "gpu", "cuda") == {"cuda"}
    for name in ("episodes.parquet", "violations.parquet"):
        assert (tmp_path / "cpu" / name).read_bytes() == (tmp_path / "gpu" / name).read_bytes()


def test_a_network_that_does_not_load_on_it_is_refused_before_the_first_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_DEVICE", "cuda")
    with pytest.raises(InputError, match="cannot be made: RuntimeError: no such device"):
        devices(tmp_path, monkeypatch, "broken", "cuda")
    assert not (tmp_path / "broken").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plant2", "carl-e"])
def test_a_device_that_is_not_there_is_one_line(name: str) -> None:
    import torch  # comes with `make test-slow`

    if torch.cuda.is_available():
        pytest.skip("has a GPU")
    with pytest.raises(InputError, match=r"^device cuda: torch sees no CUDA device here$"):
        tsbench.evaluate([name], split="test", types=("yield",), limit=1, workers=1, device="cuda")
