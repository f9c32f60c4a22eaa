"""Traces come back as they were written, and nothing else passes for one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

# The hand-made episodes are shared with the tests of the metrics.
import episode_builders as made
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import one_line
from forgeries import flip_byte, rewrite_trace, with_column
from hypothesis import given, settings
from hypothesis import strategies as st

from tsbench.core.errors import InputError
from tsbench.episode.outcome import Contact, EpisodeFacts, Outcome
from tsbench.episode.trace import read_trace, trace_path, write_trace
from tsbench.roads.planner_map import build_planner_map
from tsbench.rules.monitor import Verdicts


def an_episode(n: int = 50) -> EpisodeFacts:
    rng = np.random.default_rng(3)
    egos = [
        made.ego(10 + 0.1 * k * 1.01, speed=1.01, acceleration=float(rng.normal()), yaw_rate=-0.0) for k in range(n)
    ]
    late = made.straight(n, 30.0, -1.6, 0.0, 7.0)
    late[:20] = np.nan
    tracks = [
        made.Track("car.1", made.straight(n, 40.0, 1.6, np.pi, 9.0)),
        made.Track("bus.0", late, made.ActorKind.BUS, (12.0, 2.5)),
    ]
    return made.facts(
        egos, tracks, outcome=Outcome.COLLISION, contact=Contact(n - 1, "vehicle", "bus.0", True),
        target=made.verdict(made.violation(other="bus.0"), made.violation(9.5), steps=21),
        others=(made.verdict(engaged=False),),
        needless=(made.violation(4.0, rule="needless", clause="needless_stop"),),
    )  # fmt: skip


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A trace that a test may break."""
    path = tmp_path / "t.parquet"
    write_trace(path, made.result(an_episode()))
    return path


def test_a_trace_comes_back_bit_for_bit(tmp_path: Path) -> None:
    episode = an_episode()
    result = made.result(episode, error="none")
    path = trace_path(tmp_path, "idm", result.spec.scenario_id)
    write_trace(path, result)
    trace = read_trace(path)
    made.same_snapshots(episode.snapshots, trace.snapshots)
    assert trace.commands.tobytes() == result.commands.tobytes()
    assert repr(trace.spec) == repr(result.spec)  # repr, for the row holds a NaN
    assert (trace.planner, trace.outcome, trace.error) == ("idm", Outcome.COLLISION, "none")
    assert trace.contact == episode.contact
    assert trace.verdicts == episode.verdicts
    assert [event.start_s for event in trace.against] == [3.1, 4.0, 9.5]
    assert trace.start_remaining_m == episode.start_remaining_m
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_plans_come_back_and_older_traces_have_none(tmp_path: Path) -> None:
    episode = an_episode(4)
    told = (np.array([(1.5, 2.5), (3.25, -4.0)], dtype=np.float32), None, np.zeros((0, 2), dtype=np.float32))
    path = tmp_path / "t.parquet"
    write_trace(path, made.result(episode, plans=told))
    plans = read_trace(path).plans
    assert [None if plan is None else plan.tolist() for plan in plans] == [[[1.5, 2.5], [3.25, -4.0]], None, [], None]
    assert (plans[0].dtype, plans[2].shape) == (np.float32, (0, 2))  # type: ignore[union-attr]
    rewrite_trace(path, table=lambda ticks: ticks.drop_columns(["plan_x", "plan_y"]))
    assert read_trace(path).plans == (None,) * 4


def test_the_facts_are_found_again(tmp_path: Path) -> None:
    episode = an_episode()
    write_trace(tmp_path / "t.parquet", made.result(episode))
    again = read_trace(tmp_path / "t.parquet").facts(build_planner_map(episode.scene.network), episode.scene)
    assert (again.route.s, again.route.d, again.route.remaining) == (
        episode.route.s, episode.route.d, episode.route.remaining,
    )  # fmt: skip
    assert (again.outcome, again.contact, again.verdicts) == (episode.outcome, episode.contact, episode.verdicts)


def test_the_same_episode_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_trace(tmp_path / name, made.result(an_episode()))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("commands", [0, 1, 2])
def test_an_episode_of_one_tick_without_anyone(tmp_path: Path, commands: int) -> None:
    episode = made.facts([made.ego(10.0), made.ego(10.0)])
    given_commands = np.ones((commands, 2))
    write_trace(tmp_path / "t", made.result(episode, commands=given_commands))
    trace = read_trace(tmp_path / "t")
    made.same_snapshots(episode.snapshots, trace.snapshots)
    assert np.array_equal(trace.commands, given_commands)


def test_no_tick_no_trace(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="without a tick"):
        write_trace(tmp_path / "t", made.result(None))
    assert not list(tmp_path.iterdir())


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(allow_nan=False, width=64), min_size=11, max_size=11), st.integers(-1, 9))
def test_every_float_survives(tmp_path_factory: pytest.TempPathFactory, numbers: list[float], lane: int) -> None:
    path = tmp_path_factory.mktemp("t") / "t"
    base = an_episode(2)
    odd = made.ego(*numbers[:4], acceleration=numbers[4], steering=numbers[5], yaw_rate=numbers[6], lane=lane,
                   s=numbers[7], d=numbers[8])  # fmt: skip
    verdicts = Verdicts((made.verdict(made.violation(value=numbers[10])),))
    episode = replace(base, snapshots=made.snapshots([odd]), start_remaining_m=numbers[9], verdicts=verdicts)
    write_trace(path, made.result(episode))
    trace = read_trace(path)
    assert repr(trace.snapshots[0].ego) == repr(odd)
    assert repr(trace.start_remaining_m) == repr(numbers[9])
    assert trace.verdicts == episode.verdicts


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_a_truncated_trace_is_named(path: Path, share: float) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * share)])
    with one_line(match=r"t\.parquet: .*trace"):
        read_trace(path)


def test_a_flipped_bit_is_seen(path: Path) -> None:
    flip_byte(path, path.stat().st_size // 8)
    with pytest.raises(InputError, match=r"t\.parquet"):
        read_trace(path)


def test_foreign_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such trace"):
        read_trace(tmp_path / "missing.parquet")
    (tmp_path / "text").write_text("step,time\n0,0.0\n")
    with pytest.raises(InputError, match="cannot be read as a trace"):
        read_trace(tmp_path / "text")
    pq.write_table(pa.table({"step": [0]}), tmp_path / "other")
    with pytest.raises(InputError, match="no trace of tsbench"):
        read_trace(tmp_path / "other")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h: h.update(schema=99), "schema 99"),
        (lambda h: h.pop("target"), "target"),
        (lambda h: h["scenario"].pop("seed"), "seed"),
        (lambda h: h.update(outcome="fine"), "fine"),
        (lambda h: h["actors"]["id"].pop(), "malformed"),
        (lambda h: h["target"]["violations"].append({"rule": "speed"}), "clause: is missing"),
    ],
)
def test_other_metadata(path: Path, change: Callable[[dict[str, Any]], object], words: str) -> None:
    rewrite_trace(path, change)
    with pytest.raises(InputError, match=words) as caught:
        read_trace(path)
    assert str(caught.value).startswith(str(path))


def test_a_trace_from_before_contrast_scenes(path: Path) -> None:
    rewrite_trace(path, lambda head: head.pop("needless"))
    assert read_trace(path).verdicts.needless == ()


def test_names_make_safe_files(tmp_path: Path) -> None:
    paths = [trace_path(tmp_path, name, "s/1") for name in ("idm", "..", "../../etc", "my.py:Planner", "Ж")]
    assert len(set(paths)) == len(paths)
    for path in paths:
        assert path.resolve().parent.parent == (tmp_path / "traces").resolve()
        assert path.name == "s%2F1.parquet"
    assert paths[0].parent.name == "idm"


def repeated(path: Path, ticks: int) -> None:
    """The first tick of a trace many times over."""
    rewrite_trace(path, table=lambda table: pa.concat_tables([table.slice(0, 1)] * ticks))


@pytest.fixture
def unread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows that are read end the test."""

    def read(*_: object, **__: object) -> None:
        pytest.fail("its rows are read")

    monkeypatch.setattr(pq.ParquetFile, "read", read)


def test_more_ticks_than_the_scenario_has_are_not_read(path: Path, request: pytest.FixtureRequest) -> None:
    horizon = read_trace(path).spec.horizon
    repeated(path, horizon + 1)
    assert len(read_trace(path).snapshots) == horizon + 1
    repeated(path, horizon + 2)
    request.getfixturevalue("unread")
    with pytest.raises(InputError, match=f"{horizon + 2} ticks, of a scenario that ends after {horizon}"):
        read_trace(path)


def test_no_scenario_has_endless_ticks(path: Path, request: pytest.FixtureRequest) -> None:
    repeated(path, 10_002)
    rewrite_trace(path, lambda head: head["scenario"].update(horizon=10**9))
    request.getfixturevalue("unread")
    with pytest.raises(InputError, match=r"10002 rows, .* too large"):
        read_trace(path)


def test_few_bytes_that_unpack_to_many_are_not_read(path: Path, request: pytest.FixtureRequest) -> None:
    plan = [np.zeros(40_000_000, np.float32)]
    for name in ("plan_x", "plan_y"):
        rewrite_trace(path, table=lambda table, name=name: with_column(table.slice(0, 1), name, lambda _: plan))
    assert path.stat().st_size < 1_000_000
    request.getfixturevalue("unread")
    with pytest.raises(InputError, match=r"1 rows, 61\d MiB unpacked: too large"):
        read_trace(path)
