"""`blind`: a driver that reads no plate and knows how scenes are made. `coin`: the same, by chance.

Source: docs/floor.md.
"""

from __future__ import annotations

from dataclasses import replace

from tsbench.core.seeds import rng_of
from tsbench.planners.base import Control, Observation, PlannerContext
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.planners.floor.guess import guess
from tsbench.planners.idm import Idm


def masked(observation: Observation) -> Observation:
    """The observation with posts in place of plates, and nothing but what all planners are given."""
    return replace(observation, signs=tuple(s.masked() for s in observation.signs), truth=None)


class Blind:
    """IDM within a habit: the behaviour that the place of posts, the road and the start tell to be safest.

    It masks plates by itself before it looks, so it drives alike with and without `--mask-signs`.
    """

    privileged = False
    sign_access = False
    chooses_route = True
    floor = True

    def __init__(self) -> None:
        self._base = Idm()
        self._context: PlannerContext
        self._habit: RuleConstraint | None = None

    def reset(self, context: PlannerContext) -> None:
        """Start an episode; who is offered more than others has it taken away."""
        self._context, self._habit = replace(context, privilege=None), None
        self._base.reset(self._context)

    def act(self, observation: Observation) -> Control:
        """The base planner's command on the habit's route, within what the habit leaves."""
        return self.drive(masked(observation))

    def drive(self, seen: Observation) -> Control:
        """The command, of what is seen without plates."""
        if self._habit is None:
            self._habit = guess(self._context, seen)
        habit = self._habit or RuleConstraint()
        route = habit.route(seen)
        command = self._base.act(replace(seen, route=route))
        least, most = habit.acceleration_bounds(seen, route)
        intent = route.path.edges if route.path.edges != seen.route.path.edges else ()
        return Control(min(max(command.acceleration, least), most), command.steering, intent)


class Coin(Blind):
    """`blind` in one episode, `idm` in the next, as a coin falls: thrown anew in each half of a pair.

    obeys: how it fell, `blind` if so.
    """

    obeys = True

    def reset(self, context: PlannerContext) -> None:
        """Throw the coin. The harness gives a floor a seed of the row, not of the pair, or both halves would agree."""
        super().reset(context)
        self.obeys = rng_of("coin", context.seed).random() < 0.5
        self._habit = None if self.obeys else RuleConstraint()
