"""What the ray executor hands out together, and whom it blames for an actor that is no more; without a cluster."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from run_helpers import specs

from tsbench.episode.outcome import Outcome
from tsbench.episode.perception_level import EXACTLY
from tsbench.run.execution.messages import Finished, Limits, Setup, Task, TaskQueue, decode, encode
from tsbench.run.log.record import Record, error_row, lost_timing
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet

pytestmark = pytest.mark.slow
# Ray is large: it is imported where it is needed, in processes of their own.
WHO = PlannerInfo("fake", "fake", False, False, (), None, None)
SETUP = Setup((WHO,), EXACTLY, "cpu", "none", "/nowhere", DataSet(), "test", "")


class Method:
    def __init__(self, does: Callable[..., Any]) -> None:
        self.remote = lambda *given: lambda: does(*given)


class Actor:
    """Answers with records, but ends as soon as an episode that it cannot stand is among them."""

    def __init__(self, deadly: set[int], sent: list[list[int]]) -> None:
        def run(lines: list[bytes]) -> list[tuple[bytes, bytes]]:
            tasks = [decode(line, (Task,)) for line in lines]
            sent.append([task.number for task in tasks])
            if deadly & set(sent[-1]):
                from ray.exceptions import RayError

                raise RayError("gone")
            return [(encode(Finished(task.number, self.record(task))), b"") for task in tasks]

        self.run, self.configure = Method(run), Method(lambda *_: b"")

    @staticmethod
    def record(task: Task) -> Record:
        row = error_row(task.spec, WHO.name, False, Outcome.PLANNER_ERROR, "none")
        return Record(row, [], lost_timing(task.spec, WHO.name, 0.0), "")


Drive = Callable[[int, set[int]], tuple[list[Record], list[list[int]]]]


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch) -> Drive:
    """So many episodes on two actors, of which some cannot be stood: what is kept, and what was sent together."""
    return lambda count, deadly: driven(monkeypatch, count, deadly)


def driven(
    monkeypatch: pytest.MonkeyPatch, count: int, deadly: set[int], actors: int = 2
) -> tuple[list[Record], list[list[int]]]:
    pytest.importorskip("ray")
    from tsbench.run.execution import ray as executor_module
    from tsbench.run.execution.ray import RayExecutor, _ActorHandle

    sent: list[list[int]] = []
    monkeypatch.setattr(executor_module.ray, "get", lambda answer: answer())
    monkeypatch.setattr(executor_module.ray, "kill", lambda _: None)
    monkeypatch.setattr(executor_module.ray, "wait", lambda answers, **_: (answers[:1], answers[1:]))
    pool = RayExecutor(actors, count, Limits())
    pool._remote = type("Remote", (), {"remote": staticmethod(lambda _: Actor(deadly, sent))})
    pool._actors = [_ActorHandle(Actor(deadly, sent)) for _ in range(actors)]
    rows = (specs() * count)[:count]
    kept: list[Record] = []
    pool.run(SETUP, TaskQueue(Task(k, 0, rows[k - 1]) for k in range(1, count + 1)), kept.append, lambda: False)
    return kept, sent


def test_many_go_together_and_the_last_alone(drive: Drive) -> None:
    kept, sent = drive(400, set())
    assert len(kept) == 400
    assert sorted(number for group in sent for number in group) == list(range(1, 401)), "each once"
    assert len(sent[0]) == 20
    assert {len(group) for group in sent[-4:]} == {1}
    assert len(sent) < 60


def test_an_episode_that_takes_actors_along_is_found_and_the_others_are_not_blamed(drive: Drive) -> None:
    kept, sent = drive(60, {7})
    assert len(kept) == 60
    ended = Counter(record.row["outcome"] for record in kept)
    assert ended == {"planner_error": 59, "sim_error": 1}
    tries = [group for group in sent if 7 in group]
    assert [len(group) for group in tries[1:]] == [1, 1, 1]
    assert len(tries[0]) > 1
