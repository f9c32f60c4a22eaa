"""`reader` and `careful`: they obey what they are told of a plate, and only that. Units: m, s, m/s.

An expert is told the rule; these are told it too (how to obey is no question here), but go by it only from the tick at
which their eyes have read the plate, or its outline from behind, as what it was read. So perception decides: what is
missed is not obeyed, what is misread is obeyed as that. They differ in what they do about a post that they have not
read.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from tsbench.core.errors import InputError
from tsbench.planners.base import Control, Observation, PlannerContext, Privilege, SignView
from tsbench.planners.experts.expert import Expert
from tsbench.planners.experts.rules.constraint import slow_to
from tsbench.planners.floor.guess import Blind
from tsbench.planners.helpers import identified, sign_ahead
from tsbench.planners.idm import Idm, IdmParameters

# Told places are off by a few metres along the road; no two posts of one scene that face the same way are nearer.
_SAME_POST_M = 4.0
_SLOW_WITHIN_M, _BRAKE_MPS2, _SHARE = 40.0, 2.0, 0.55


class Reader:
    """`idm` until the plate is read; then `idm-e` under the plate as it was read.

    driver: how it drives in both cases.
    """

    privileged = True
    sign_access = True
    driver: ClassVar[IdmParameters] = IdmParameters()

    def __init__(self) -> None:
        self._base = Idm(self.driver)
        self._context: PlannerContext
        self._privilege: Privilege
        self._told: tuple[str, float | None] | None = None
        self._expert: Expert | None = None

    def reset(self, context: PlannerContext) -> None:
        if context.privilege is None:
            raise InputError("reader and its kin need PlannerContext.privilege: privileged = True")
        self._context, self._privilege = context, context.privilege
        self._told, self._expert = None, None
        self._base.reset(replace(context, privilege=None))

    def act(self, observation: Observation) -> Control:
        at = self._privilege.sign
        there = (sign for sign in observation.signs if math.hypot(sign.x - at.x, sign.y - at.y) < _SAME_POST_M)
        told = map(identified, there)
        read = next((sign for sign in told if sign.code), None)
        if read is not None and self._told != (read.code, read.value):
            self._told, self._expert = (read.code, read.value), self.obeying(read)
        if self._expert is not None:
            try:
                return self._expert.act(observation)
            except InputError:
                # What was read leaves no way: it must be misread, so it is as if nothing stood there.
                if self._told == (at.code, at.value):
                    raise
                self._expert = None
        return self.unread(observation, self._base.act(replace(observation, truth=None)))

    def unread(self, observation: Observation, command: Control) -> Control:
        """What becomes of a command as long as the plate is not read: nothing."""
        del observation
        return command

    def obeying(self, read: SignView) -> Expert:
        """The expert that obeys a plate as it was read."""
        sign = replace(self._privilege.sign, code=read.code, value=read.value)
        expert = Expert(Idm(self.driver))
        expert.reset(replace(self._context, privilege=replace(self._privilege, sign=sign)))
        return expert


class Careful(Reader):
    """Takes a post that it has not read for what is safest there, as `blind` does, and goes slowly towards it.

    A slow ego has more looks, and time to obey what they tell.
    """

    def __init__(self) -> None:
        super().__init__()
        self._blind = Blind()

    def reset(self, context: PlannerContext) -> None:
        super().reset(context)
        self._blind.reset(context)

    def unread(self, observation: Observation, command: Control) -> Control:
        ego, route = observation.ego, observation.route
        posts = [sign for sign in observation.signs if not (sign.code or sign.outline)]
        if not posts:
            return command
        command = self._blind.act(observation)
        target = _SHARE * route.path.limit_at(route.s)
        most = math.inf
        for post in posts:
            ahead = sign_ahead(observation, post)
            if 0.0 < ahead < math.inf:
                most = min(most, slow_to(ego.speed, target, max(ahead - _SLOW_WITHIN_M, 0.0), _BRAKE_MPS2))
        return replace(command, acceleration=min(command.acceleration, most))
