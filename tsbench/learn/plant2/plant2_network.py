"""The network: tokens through a BERT-like encoder, heads for path, waypoints, speed and forecast.

Source: PlanT 2.0 (arXiv 2511.07292), docs/planners.md. Batch-first tensors of float32. Results of one sample do
not depend on the others of its batch, to the bit: no batch statistics, and small matrices are multiplied per sample.

`inference` gives plans by torch, for a GPU; what drives on a CPU is `engine.py`. Samples are grouped by how many
objects they hold, so that a sample's plan hangs little on the others of its batch. Its last bits depend on the device
and on torch's version.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.engine import target_speed_of
from tsbench.learn.plant2.sign_tokens import vocabulary_of
from tsbench.learn.plant2.tokens import PATH, QUERIES, SIZES, SPEED, TILE, TILE_FEATURES, WAYPOINT
from tsbench.planners.base import Infer


@dataclass(frozen=True, slots=True)
class NetworkPlan:
    """The heads' answers. path: (b, 20, 2), waypoints: (b, 8, 2) m in the ego's frame; speed: (b, 8) logits.

    forecast: (b, k, 2, 2) how far each object moves within each of FORECAST_S, ahead and left of its heading of now;
    None where it was not asked for.
    """

    path: Tensor
    waypoints: Tensor
    speed: Tensor
    forecast: Tensor | None


class Residual(nn.Module):
    """Two convolutions and a way around them (He et al. 2016), normalised per sample."""

    def __init__(self, source: int, target: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(source, target, 3, stride, 1, bias=False)
        self.first_norm = nn.GroupNorm(8, target)
        self.second = nn.Conv2d(target, target, 3, 1, 1, bias=False)
        self.second_norm = nn.GroupNorm(8, target)
        self.around = nn.Conv2d(source, target, 1, stride, bias=False) if stride > 1 else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        """(b, source, h, w) to (b, target, h / stride, w / stride)."""
        inner = torch.relu(self.first_norm(self.first(x)))
        return torch.relu(self.second_norm(self.second(inner)) + self.around(x))


class ResidualPatch(nn.Module):
    """The bird's-eye patch as one token by a ResNet-18 with normalisation per sample (`medium`)."""

    def __init__(self, width: int, channels: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = [
            nn.Conv2d(at.PATCH_CHANNELS, channels[0], 7, 2, 3, bias=False),
            nn.GroupNorm(8, channels[0]),
            nn.ReLU(),
        ]
        source = channels[0]
        for target in channels:
            layers += [Residual(source, target, 2), Residual(target, target, 1)]
            source = target
        self.trunk = nn.Sequential(*layers)
        shrink = 2 ** (len(channels) + 1)
        self.out = nn.Linear(source * (at.PATCH_ROWS // shrink) * (at.PATCH_COLUMNS // shrink), width)

    def forward(self, patch: Tensor) -> Tensor:
        """(b, 3, rows, columns) of 0 to 1 to (b, 1, width)."""
        if self.training:
            return per_sample(self.out, self.trunk(patch).flatten(1)[:, None])
        # Torch convolves a single image by another routine than several.
        return per_sample(self.out, torch.stack([self.trunk(p[None]).flatten(1) for p in patch]))


class TiledPatch(nn.Module):
    """The bird's-eye patch as one token by two products: each tile on its own, then all together (`mini`)."""

    def __init__(self, width: int, tile: int, features: int) -> None:
        super().__init__()
        self.tile = tile
        self.each = nn.Linear(at.PATCH_CHANNELS * tile * tile, features)
        self.out = nn.Linear(features * (at.PATCH_ROWS // tile) * (at.PATCH_COLUMNS // tile), width)

    def forward(self, patch: Tensor) -> Tensor:
        """(b, 3, rows, columns) of 0 to 1 to (b, 1, width)."""
        tiles = nn.functional.unfold(patch, self.tile, stride=self.tile).transpose(1, 2)
        features = nn.functional.gelu(per_sample(self.each, tiles))
        return per_sample(self.out, features.flatten(1)[:, None])


class Head(nn.Module):
    """Two linear layers on the tokens of one kind."""

    def __init__(self, width: int, hidden: int, out: int) -> None:
        super().__init__()
        self.first = nn.Linear(width, hidden)
        self.second = nn.Linear(hidden, out)

    def forward(self, x: Tensor) -> Tensor:
        """(b, k, width) to (b, k, out)."""
        return per_sample(self.second, nn.functional.gelu(per_sample(self.first, x)))


def per_sample(linear: nn.Linear, x: Tensor) -> Tensor:
    """`linear` on (b, k, in) by one product of fixed shape a sample: rows of several samples are never mixed.

    In training they may be, which spares a gradient of the weights for each sample.
    """
    if linear.training:
        return cast(Tensor, linear(x))
    weight = linear.weight.t().expand(len(x), -1, -1)
    return torch.baddbmm(linear.bias, x, weight)


class ClassProjection(nn.Module):
    """A linear layer of its own for each class of tokens. Class 0 is the empty slot, which has none."""

    def __init__(self, classes: int, features: int, width: int) -> None:
        super().__init__()
        self.classes = classes
        self.weight = nn.Parameter(0.02 * torch.randn(classes - 1, features, width))
        self.bias = nn.Parameter(0.02 * torch.randn(classes - 1, width))

    def forward(self, kinds: Tensor, features: Tensor) -> Tensor:
        """(b, k) classes and (b, k, features) to (b, k, width); zero for empty slots."""
        # One product for all: each token's features stand in the columns of its class.
        chosen = nn.functional.one_hot(kinds, self.classes)[..., 1:].to(features.dtype)
        spread = (chosen[..., None] * features[..., None, :]).flatten(2)
        table = torch.cat([self.weight.flatten(0, 1), self.bias])
        rows = torch.cat([spread, chosen], dim=2)
        return rows @ table if self.training else torch.bmm(rows, table.expand(len(kinds), -1, -1))


class Plant2Network(nn.Module):
    """Tokens in, a plan out. `size`: a name of SIZES.

    Encoded tokens stand in this order: queries, route, limits, patch (`front` of them), objects.
    """

    front = QUERIES + 3

    def __init__(self, size: str) -> None:
        super().__init__()
        s = SIZES[size]
        self.queries = nn.Parameter(0.02 * torch.randn(QUERIES, s.width))
        self.objects = ClassProjection(at.OBJECT_CLASSES, at.OBJECT_FEATURES, s.width)
        self.route = nn.Linear(2 * at.ROUTE_POINTS, s.width)
        self.limits = nn.Linear(len(at.LIMIT_AHEAD_M), s.width)
        self.patch: nn.Module = ResidualPatch(s.width, s.patch) if s.patch else TiledPatch(s.width, TILE, TILE_FEATURES)
        layer = nn.TransformerEncoderLayer(
            s.width, s.heads, s.feedforward, s.dropout, activation="gelu", batch_first=True
        )
        self.encoder = nn.TransformerEncoder(layer, s.layers, enable_nested_tensor=False)
        self.path_head = Head(s.width, s.hidden, 2 * at.PATH_POINTS)
        self.waypoint_head = Head(s.width, s.hidden, 2 * at.WAYPOINTS)
        self.speed_head = Head(s.width, s.hidden, len(at.SPEEDS))
        self.forecast_head = Head(s.width, s.hidden, 2 * len(at.FORECAST_S))

    def embed(self, tokens: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """All tokens (b, t, width), queries first and objects last, and which of them are empty (b, t)."""
        b = len(tokens["objects"])
        kinds = tokens["kinds"].long()
        objects = self.objects(kinds, tokens["objects"])
        front = [
            self.queries.expand(b, -1, -1),
            per_sample(self.route, tokens["route"].flatten(1)[:, None]),
            per_sample(self.limits, tokens["limits"][:, None]),
            self.patch(tokens["patch"].float() / 255.0),
        ]
        seen = kinds.new_zeros((b, sum(part.shape[1] for part in front)), dtype=torch.bool)
        return torch.cat([*front, objects], dim=1), torch.cat([seen, kinds == at.EMPTY], dim=1)

    def forward(self, tokens: Mapping[str, Tensor], forecast: bool = True) -> NetworkPlan:
        """The plan for a batch of `tokens.TOKENS` as tensors; the last slots of objects may be left out."""
        x = self.encode(*self.embed(tokens))
        plan = self.plan(x)
        return replace(plan, forecast=self.forecast(x, tokens["objects"].shape[1])) if forecast else plan

    def encode(self, x: Tensor, empty: Tensor) -> Tensor:
        return cast(Tensor, self.encoder(x, src_key_padding_mask=empty))

    def plan(self, x: Tensor) -> NetworkPlan:
        """What the heads make of the queries; steps are added up to points."""
        path = self.path_head(x[:, PATH : PATH + 1]).view(-1, at.PATH_POINTS, 2)
        waypoints = self.waypoint_head(x[:, WAYPOINT : WAYPOINT + 1]).view(-1, at.WAYPOINTS, 2)
        speed = self.speed_head(x[:, SPEED : SPEED + 1])[:, 0]
        return NetworkPlan(path.cumsum(1), waypoints.cumsum(1), speed, None)

    def forecast(self, x: Tensor, objects: int) -> Tensor:
        """Where the objects, which are the last tokens, will be."""
        return cast(Tensor, self.forecast_head(x[:, -objects:])).view(len(x), objects, len(at.FORECAST_S), 2)


class Plant2FtNetwork(Plant2Network):
    """With tokens for signs, those that hold, ways on and the speed, whose head gives the target speed.

    Inputs: `tokens.SIGN_TOKENS`. classes: how many codes its vocabulary of signs has.
    """

    def __init__(self, size: str, classes: int) -> None:
        super().__init__(size)
        width = SIZES[size].width
        self.ways = nn.Linear(at.WAY_FEATURES, width)
        self.signs = ClassProjection(classes + 1, at.SIGN_FEATURES, width)
        self.held = nn.ModuleList(ClassProjection(classes + 1, at.HELD_FEATURES, width) for _ in range(at.HELD))
        self.speed_token = nn.Parameter(0.02 * torch.randn(width))
        self.ego_speed_head = nn.Linear(width, len(at.SPEEDS))

    def take_over(self, base: Plant2Network) -> None:
        """Begin with a base network's weights; points of ways are read like the route's, what else is new as drawn."""
        left_out = self.load_state_dict(base.state_dict(), strict=False)
        assert not left_out.unexpected_keys
        with torch.no_grad():
            self.ways.weight[:, : 2 * at.ROUTE_POINTS] = self.route.weight

    def embed(self, tokens: Mapping[str, Tensor]) -> tuple[Tensor, Tensor]:
        """The base's tokens with speed token, signs that hold, signs and ways before the objects."""
        x, empty = super().embed(tokens)
        classes, holding = tokens["sign_classes"].long(), tokens["held_classes"].long()
        b, objects = len(classes), tokens["objects"].shape[1]
        new = [
            self.speed_token.expand(b, 1, -1),
            *(held(holding[:, k : k + 1], tokens["held"][:, k : k + 1]) for k, held in enumerate(self.held)),
            self.signs(classes, tokens["signs"]),
            per_sample(self.ways, tokens["ways"]),
        ]
        unseen = [empty.new_zeros((b, 1)), holding == at.EMPTY, classes == at.EMPTY, tokens["way_known"] == 0]
        split = x.shape[1] - objects
        return (
            torch.cat([x[:, :split], *new, x[:, split:]], dim=1),
            torch.cat([empty[:, :split], *unseen, empty[:, split:]], dim=1),
        )

    def plan(self, x: Tensor) -> NetworkPlan:
        """The base's plan with the speed of the new head."""
        base = super().plan(x)
        token = x[:, self.front : self.front + 1]
        return NetworkPlan(base.path, base.waypoints, per_sample(self.ego_speed_head, token)[:, 0], None)


def parts(size: str) -> list[tuple[str, int, str]]:
    """Parameters of parts of `plant2` and of what `plant2-ft` adds, each with its sum, and the published number."""
    nets = Plant2Network(size), Plant2FtNetwork(size, len(vocabulary_of().codes))
    base, tuned = (_parameters_of(net) for net in nets)
    medium = size == "medium"
    added = tuned.total() - base.total() - tuned["ways"]
    return [
        *((name, count, "") for name, count in base.items()),
        ("plant2", base.total(), "37.2 M" if medium else ""),
        *((f"+ {name}", count, "") for name, count in tuned.items() if name not in base),
        ("added by plant2-ft but ways", added, f"{147_976:,}" if medium else ""),
    ]


def _parameters_of(net: Plant2Network) -> Counter[str]:
    found: Counter[str] = Counter()
    for name, parameter in net.named_parameters():
        found[name.partition(".")[0]] += parameter.numel()
    return found


# Slots for objects: an empty street costs less than a full one.
BUCKETS = (6, 14, at.OBJECTS)


def inference(net: Plant2Network, device: str) -> Infer:
    """A network that answers (b,) records of TOKENS (SIGN_TOKENS, where it reads signs) with (b,) of PLAN."""
    net = net.to(device).eval()

    def infer(records: at.Records) -> at.Records:
        answers: at.Records = np.empty(len(records), dtype=at.PLAN)
        counts = np.count_nonzero(records["kinds"], axis=1)
        slots = np.take(BUCKETS, np.searchsorted(BUCKETS, counts))
        with torch.inference_mode():
            for bucket in BUCKETS:
                rows = np.flatnonzero(slots == bucket)
                if len(rows):
                    answers[rows] = _group(net, records[rows], bucket, device)
        return answers

    return infer


def _group(net: Plant2Network, batch: at.Records, slots: int, device: str) -> at.Records:
    tokens = {name: value.to(device) for name, value in tensors(batch, slots).items()}
    plan = net(tokens, forecast=False)
    answers: at.Records = np.empty(len(batch), dtype=at.PLAN)
    answers["path"], answers["waypoints"] = plan.path.cpu().numpy(), plan.waypoints.cpu().numpy()
    answers["speed"], answers["standing"] = target_speed_of(plan.speed.cpu().double().numpy())
    return answers


def tensors(batch: at.Records, slots: int = at.OBJECTS) -> dict[str, torch.Tensor]:
    """Records as tensors by field, with the first `slots` objects; a copy."""
    found = {}
    for name in batch.dtype.names or ():
        values = batch[name][:, :slots] if name in ("objects", "kinds") else batch[name]
        # A record's fields lie apart, which torch does not take, and a view of one row passes for contiguous.
        found[name] = torch.from_numpy(values.copy())
    return found


def network_of(size: str, weights: Mapping[str, Any]) -> Plant2Network:
    """A network with given arrays, the fine-tuned one where they have a part of it.

    Raises KeyError or RuntimeError where they fit none.
    """
    net = Plant2Network(size)
    if "speed_token" in weights:
        net = Plant2FtNetwork(size, len(weights["signs.weight"]))
    net.load_state_dict({key: torch.from_numpy(np.array(value)) for key, value in weights.items()})
    return net
