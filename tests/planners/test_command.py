"""What a planner may return, and what of it is no command."""

from __future__ import annotations

import numpy as np
import pytest
from run_helpers import episode_builders

from tsbench.core.errors import PlannerOutputError
from tsbench.planners.base import Control, Trajectory, to_command, to_plan
from tsbench.sim.ego import Motion

MOTION = Motion(0.0, 0.0, 0.0, 5.0)


class Refuses:
    """A number that raises when it is read."""

    def __float__(self) -> float:
        raise GeneratorExit("read")


def command(output: object):
    return to_command(output, MOTION, episode_builders.scene().network)


@pytest.mark.parametrize("value", [1, 1.5, True, np.float32(1.5), np.int64(1), np.array(1.5)])
def test_numbers_of_all_kinds(value: object) -> None:
    (acceleration, steering), intent = command(Control(value, 0.0))
    assert (type(acceleration), acceleration, steering, intent) == (float, float(value), 0.0, ())


@pytest.mark.parametrize(
    ("output", "words"),
    [
        (None, "act returned NoneType"),
        (Control(10**400, 0), "int too large to convert to float"),
        (Control(float("nan"), 0.0), "not finite"),
        (Control(0.0, -float("inf")), "not finite"),
        (Control("1.5", 0.0), "holds str and float, expected two numbers"),
        (Control(None, 0.0), "holds NoneType and float"),
        (Control(1j, 0.0), "holds complex and float"),
        (Control([1.0], 0.0), "holds list and float"),
        (Control(np.zeros(1_000_000), 0.0), "no number of a vehicle"),
        (Control(Refuses(), 0.0), "Control cannot be read (GeneratorExit: read)"),
        (Control(0.0, 0.0, ["a"]), "intent is list"),
        (Control(0.0, 0.0, ("no such edge" * 100,)), "which is not in the network"),
        (Control(0.0, 0.0, ({},)), "which is not in the network"),
        (Trajectory([1.0], np.zeros((1, 3))), "Trajectory.times is list"),
        (Trajectory(np.array([1.0]), None), "Trajectory.poses is NoneType"),
        (Trajectory(np.array([1.0, None]), np.zeros((2, 3))), "Trajectory.times is an array of object"),
        (Trajectory(np.array([1j]), np.zeros((1, 3))), "Trajectory.times is an array of complex128"),
        (Trajectory(np.array(["1"]), np.zeros((1, 3))), "Trajectory.times is an array of <U1"),
        (Trajectory(np.arange(1.0, 1e6), np.zeros((999_999, 3))), "trajectory has shapes"),
        (Trajectory(np.array([1.0, 2.0]), np.full((2, 3), np.nan)), "NaN or infinity"),
        (Trajectory(np.array([1e-300, 1.0]), np.full((2, 3), 1e308)), "beyond what numbers can hold"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_is_no_command(output: object, words: str) -> None:
    with pytest.raises(PlannerOutputError) as told:
        command(output)
    assert words in str(told.value)
    assert len(str(told.value)) < 300


def test_a_plan_is_a_copy_of_plain_numbers() -> None:
    points = np.array([(1, 2), (3, 4)])
    plan = to_plan(Control(0.0, 0.0, plan=points))
    points[:] = 0
    assert (plan.dtype, plan.tolist()) == (np.float32, [[1.0, 2.0], [3.0, 4.0]])
    poses = np.array([(5.0, 6.0, 0.1), (1e300, 8.0, 0.1)])
    plan = to_plan(Trajectory(np.array([1.0, 2.0]), poses))
    assert plan.tolist() == [[5.0, 6.0], [1e6, 8.0]]
    assert to_plan(Control(0.0, 0.0)) is None
    assert to_plan(Control(0.0, 0.0, plan=np.zeros((0, 2)))).shape == (0, 2)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ([(0.0, 0.0)], "Control.plan is list, expected a NumPy array of numbers"),
        (np.array([("a", "b")]), "Control.plan is an array of <U1"),
        (np.zeros(4), "Control.plan has shape (4,), expected (k, 2)"),
        (np.zeros((4, 3)), "Control.plan has shape (4, 3)"),
        (np.zeros((1001, 2)), "Control.plan has shape (1001, 2)"),
        (np.full((2, 2), np.nan), "Control.plan holds NaN"),
    ],
)
def test_what_is_no_plan(plan: object, words: str) -> None:
    with pytest.raises(PlannerOutputError) as told:
        to_plan(Control(0.0, 0.0, plan=plan))  # type: ignore[arg-type]
    assert words in str(told.value)
