"""`plant2-ft`'s network: the base with sign tokens, a sign-state token, a speed token and a head for the ego's speed.

Source: docs/spec/planners.md: 147,976 parameters more at `medium`. A token for each way on is tsbench's own (ways.py).
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.network import ClassProjection, Plan, Plant2Network, per_sample
from tsbench.planners.plant2.signs import CLASSES, VOCABULARY
from tsbench.planners.plant2.sizes import SIZES


class Plant2FtNetwork(Plant2Network):
    """As `Plant2Network`; its tokens hold the fields of `layout.SIGN_TOKENS`. The wished speed is the new head's."""

    def __init__(self, size: str) -> None:
        super().__init__(size)
        width = SIZES[size].width
        self.ways = nn.Linear(at.WAY_FEATURES, width)
        self.signs = ClassProjection(len(CLASSES) + 1, at.SIGN_FEATURES, width)
        self.sign_state = nn.Embedding(len(VOCABULARY) + 1, width)
        self.speed_token = nn.Parameter(0.02 * torch.randn(width))
        self.ego_speed_head = nn.Linear(width, len(at.SPEEDS))
        nn.init.normal_(self.sign_state.weight, std=0.02)

    def take_over(self, base: Plant2Network) -> None:
        """Begin with a base network's weights; points of ways are read like the route's, what else is new as drawn."""
        left_out = self.load_state_dict(base.state_dict(), strict=False)
        assert not left_out.unexpected_keys
        with torch.no_grad():
            self.ways.weight[:, : 2 * at.ROUTE_POINTS] = self.route.weight

    def embed(self, tokens: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """The base's tokens with speed token, sign state, signs and ways before the objects."""
        x, empty = super().embed(tokens)
        classes = tokens["sign_classes"].long()
        b, objects = len(classes), tokens["objects"].shape[1]
        new = [
            self.speed_token.expand(b, 1, -1),
            self.sign_state(tokens["sign_state"].long())[:, None],
            self.signs(classes, tokens["signs"]),
            per_sample(self.ways, tokens["ways"]),
        ]
        unseen = [empty.new_zeros((b, 2)), classes == at.EMPTY, tokens["way_known"] == 0]
        split = x.shape[1] - objects
        return (
            torch.cat([x[:, :split], *new, x[:, split:]], dim=1),
            torch.cat([empty[:, :split], *unseen, empty[:, split:]], dim=1),
        )

    def plan(self, x: Tensor) -> Plan:
        """The base's plan with the speed that the new head wishes."""
        base = super().plan(x)
        token = x[:, self.front : self.front + 1]
        return Plan(base.path, base.waypoints, per_sample(self.ego_speed_head, token)[:, 0], None)
