"""MetaDrive's network in tsbench: what it is shown, what its answers do, and which file its weights are taken from."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from learned_scenes import Recorder, record

from tsbench.bridges.metadrive import (
    SIZE,
    WHEEL,
    WHEEL_NAME,
    MetaDriveEyes,
    MetaDrivePolicy,
    MetaDrivePpo,
    acceleration_of,
    read_weights,
)
from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.observation import Observation
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.sim.world import ActorKind

# Where the numbers stand.
LEFT, RIGHT, HEADING, SPEED, STEERED, THROTTLE, YAW, PLACE = 0, 1, 2, 3, 5, 6, 7, 8
AHEAD, ASIDE, WIDE, CLOCKWISE, ANGLE = range(9, 14)
OTHERS, LIDAR = 19, 35


@pytest.fixture(scope="module")
def o(drive: Recorder) -> Observation:
    """On a straight piece of road, in the middle of a lane."""
    found = drive.seen[0]
    return replace(found, ego=replace(found.ego, d=0.0))


def see(drive: Recorder, o: Observation, last: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    seen = MetaDriveEyes(drive.context.network).see(o, last)
    assert seen.shape == (SIZE,)
    assert seen.dtype == np.float32
    assert seen.min() >= 0.0
    assert seen.max() <= 1.0
    return seen


def test_its_own_state(drive: Recorder, o: Observation) -> None:
    lane = drive.context.network.lanes[o.ego.lane]
    heading = lane.line.heading_at(o.ego.s)
    still = replace(o, ego=replace(o.ego, heading=heading, speed=0.0, yaw_rate=0.0))
    seen = see(drive, still)
    assert seen[[HEADING, STEERED, THROTTLE, YAW, PLACE]] == pytest.approx([0.5, 0.5, 0.5, 0.0, 0.5], abs=1e-6)
    assert seen[SPEED] == pytest.approx(1 / 81)
    assert 18.0 * (seen[LEFT] + seen[RIGHT]) == pytest.approx(
        sum(one.width for one in drive.context.network.edge_lanes(lane.edge)), abs=1e-4
    )
    # To the right: less room there, and the lane's middle to the left. Turned to the right by 0.1 rad.
    right = see(drive, replace(still, ego=replace(still.ego, d=-0.9, heading=heading - 0.1, speed=10.0)), (1.0, -0.5))
    assert right[RIGHT] - seen[RIGHT] == pytest.approx(-0.9 / 18.0, abs=1e-6)
    assert right[PLACE] == pytest.approx(0.7)
    assert right[HEADING] == pytest.approx(0.5 + 0.5 * math.sin(0.1))
    assert right[SPEED] == pytest.approx(37 / 81)
    assert right[[STEERED, THROTTLE]] == pytest.approx([1.0, 0.25])


def test_navigation_is_of_this_piece_and_the_next(drive: Recorder, o: Observation) -> None:
    seen = see(drive, o)
    path, s = o.route.path, o.route.s
    end = next(piece.s1 for piece in path.pieces if piece.s1 > s)
    x, y = path.line.point_at(end)
    far = math.hypot(x - o.ego.x, y - o.ego.y)
    assert math.hypot(*(2 * seen[[AHEAD, ASIDE]] - 1)) == pytest.approx(min(far / 50.0, 1.0), abs=1e-5)
    turned = see(drive, replace(o, ego=replace(o.ego, heading=o.ego.heading + 0.3)))
    # Who is turned to the left has it more to the right.
    assert turned[ASIDE] > seen[ASIDE] + 0.05
    assert seen[[WIDE, CLOCKWISE, ANGLE]] == pytest.approx([0.0, 0.5, 0.5])


def test_vehicles_alone_are_others(drive: Recorder) -> None:
    o = next(o for o in drive.seen if len(o.actors))
    ego, car = o.ego, int(np.flatnonzero(o.actors.kind != ActorKind.PEDESTRIAN)[0])
    place = np.array([ego.x + 20.0 * math.cos(ego.heading), ego.y + 20.0 * math.sin(ego.heading), ego.heading])
    pose, speed = o.actors.pose.copy(), o.actors.speed.copy()
    pose[car], speed[car] = place, ego.speed + 5.0
    boxes = tuple((*row, *box[3:]) for row, box in zip(pose.tolist(), o.actors.boxes, strict=True))
    seen = see(drive, replace(o, actors=replace(o.actors, pose=pose, speed=speed, boxes=boxes), obstacles=()))
    # Straight ahead at 20 m, and faster by 5 m/s.
    ahead = [0.5 + 20.0 / 100.0, 0.5, 0.5 + 3.6 * 5.0 / 160.0, 0.5]
    assert any(seen[OTHERS + 4 * k : OTHERS + 4 * k + 4] == pytest.approx(ahead, abs=1e-5) for k in range(4))
    assert seen[LIDAR] == pytest.approx((20.0 - o.actors.length[car] / 2) / 50.0, abs=1e-4)
    empty = see(drive, replace(o, actors=o.actors.none(), obstacles=()))
    assert not empty[OTHERS:LIDAR].any()
    assert (empty[LIDAR:] == 1.0).all()


@pytest.mark.parametrize(
    ("throttle", "speed", "does"),
    [
        (1.0, 0.0, 2.9),
        (1.0, 10.0, 2.54),
        (1.0, 23.0, -0.36),
        (0.0, 10.0, -0.36),
        (-0.1, 10.0, -2.73),
        (-1.0, 10.0, -8.8),
    ],
)
def test_a_throttle_does_what_it_does_to_its_car(throttle: float, speed: float, does: float) -> None:
    assert acceleration_of(throttle, speed) == pytest.approx(does)


def test_a_file_that_is_not_that_wheel_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(WHEEL, raising=False)
    with pytest.raises(InputError, match=r"pip download --no-deps metadrive-simulator==0\.4\.3"):
        MetaDrivePpo()
    wrong = tmp_path / WHEEL_NAME
    wrong.write_text("no archive", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read"):
        read_weights(wrong)
    with zipfile.ZipFile(wrong, "w") as archive:
        archive.writestr("metadrive/examples/ppo_expert/expert_weights.npz", b"other weights")
    with pytest.raises(InputError, match="has not the SHA-256"):
        read_weights(wrong)


def test_a_policy_of_ones_own_is_shown_what_it_said_before() -> None:
    """As the guide writes it: full throttle in small steps of steering, beyond what MetaDrive takes."""
    shown: list[np.ndarray] = []

    class Mine(MetaDrivePolicy):
        make = staticmethod(lambda: lambda seen: (shown.append(seen), (0.5, 3.0))[1])

    drive = record()
    planner = Mine()
    planner.reset(drive.context)
    for o in drive.seen[:2]:
        command = planner.act(o)
        assert command.acceleration == acceleration_of(1.0, o.ego.speed)
        assert command.steering == pytest.approx(math.radians(20.0))
    assert shown[0][[STEERED, THROTTLE]] == pytest.approx([0.5, 0.5])
    assert shown[1][[STEERED, THROTTLE]] == pytest.approx([0.75, 1.0])


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The public wheel: where it is already, or from the package index."""
    named = os.environ.get(WHEEL)
    folder = tmp_path_factory.mktemp("wheel")
    if not named:
        asked = ("-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(folder), "metadrive-simulator==0.4.3")
        try:
            came = subprocess.run([sys.executable, *asked], capture_output=True, timeout=120, check=False)
        except subprocess.TimeoutExpired:
            pytest.skip("the package index is too slow for a wheel of 55 MB")
        if came.returncode:
            pytest.skip("no package index that has metadrive-simulator 0.4.3")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(WHEEL, named or str(folder / WHEEL_NAME))
        yield Path(os.environ[WHEEL])


@pytest.mark.slow
def test_it_drives_as_published_and_the_same_again(wheel: Path) -> None:
    rows = [row for row in DataSet().table("dev") if row.scenario_type in ("no_entry", "speed_limit", "yield")]
    runner = EpisodeRunner(resolve("metadrive-ppo"))
    first = [runner.run(row) for row in rows[:5]]
    again = [runner.run(row) for row in rows[:5]]
    runner.close()
    assert not any(result.outcome.is_error for result in first), [result.error for result in first]
    assert [r.commands.tobytes() for r in first] == [r.commands.tobytes() for r in again]
    assert any(result.outcome == "arrived" for result in first)
