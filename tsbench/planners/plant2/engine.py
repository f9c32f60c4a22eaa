"""The network without torch: the same plan, in the same bits, on every CPU and in every batch.

Only tokens that are there are reckoned with, and in the last layer only those whose answers somebody reads: exact sums
make both free of consequences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp
from tsbench.geometry.polyline import Array
from tsbench.planners.common.fixed_point import BITS, SUM_BITS, Curve, Linear, gelu, snap, softmax, tree_sum
from tsbench.planners.common.parameters import Parameters
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.engine_patch import ResidualPatch, TiledPatch
from tsbench.planners.plant2.sizes import PATH, QUERIES, SIZES, SPEED, WAYPOINT

# Inputs beyond are cut, and embedded tokens that are longer are shortened, which bounds all that follows.
_MOST, _LONGEST = 32.0, 64.0
_SHARE_BITS = 24
_SPEEDS = np.array(at.SPEEDS)


class Head:
    def __init__(self, of: Parameters, name: str, norm: float) -> None:
        self._first = Linear(*of.linear(f"{name}.first"), bound=norm, norm=norm, snapped=None)
        self._bend = gelu(math.ceil(self._first.bound))
        self._second = Linear(*of.linear(f"{name}.second"), bound=self._first.bound, snapped=None)

    def __call__(self, x: Array) -> Array:
        """(n, width) to (n, out)."""
        return self._second(self._bend(self._first(x)))


class Layer:
    """One layer of the encoder: attention and two linear layers, each added to its input and normalised.

    norm: most that an input's Euclidean norm is; afterwards that of an output.
    """

    def __init__(self, of: Parameters, name: str, heads: int, norm: float) -> None:
        weight, bias = of.take(f"{name}.self_attn.in_proj_weight"), of.take(f"{name}.self_attn.in_proj_bias")
        width = weight.shape[1]
        self._heads, self._width, each = heads, width, width // heads
        weight, bias = weight.astype(np.float64), bias.astype(np.float64)
        weight[:width] /= math.sqrt(each)
        bias[:width] /= math.sqrt(each)
        # Queries and keys as fine as their products' sums allow.
        most = np.sqrt(np.square(weight).sum(axis=1)) * norm + np.abs(bias)
        sums = (most[:width] * most[width : 2 * width]).reshape(heads, each).sum(axis=1).max()
        crossed = min((SUM_BITS - math.ceil(math.log2(max(sums, 1.0)))) // 2, BITS)
        snapped = np.repeat([crossed, BITS], [2 * width, width]).astype(np.float64)
        value_bound = float(most[2 * width :].max())
        # Shares add up to 1, and then to values.
        self._share_bits = min(
            SUM_BITS - BITS - math.ceil(math.log2(2.0 * max(value_bound, 1.0))), _SHARE_BITS
        )
        self._project = Linear(weight, bias, bound=norm, norm=norm, snapped=snapped)
        self._join = Linear(*of.linear(f"{name}.self_attn.out_proj"), bound=value_bound, snapped=None)
        self._attended, self._done = of.norm(f"{name}.norm1"), of.norm(f"{name}.norm2")
        between = self._attended.norm
        self._wide = Linear(*of.linear(f"{name}.linear1"), bound=between, norm=between, snapped=None)
        self._bend: Curve = gelu(math.ceil(self._wide.bound))
        self._narrow = Linear(*of.linear(f"{name}.linear2"), bound=self._wide.bound, snapped=None)
        self.norm = self._done.norm

    def __call__(self, x: Array, ends: list[int], kept: npt.NDArray[np.intp] | None = None) -> Array:
        """(n, width): tokens of one sample after the other. ends: where each sample's end. kept: whose answers are
        wanted, None for all.
        """
        heads, width = self._heads, self._width
        projected = self._project(x)
        parts = projected.reshape(len(x), 3, heads, width // heads)
        # Each of the three (heads, n, width of a head).
        queries, keys, values = parts.transpose(1, 2, 0, 3)
        asked = np.arange(len(x)) if kept is None else kept
        cuts = np.searchsorted(asked, ends).tolist()
        if kept is not None:
            queries, x = queries[:, kept], x[kept]
        mixed = np.empty((len(x), heads, width // heads))
        start = first = 0
        for end, last in zip(ends, cuts, strict=True):
            shares = softmax(queries[:, first:last] @ keys[:, start:end].transpose(0, 2, 1), self._share_bits)
            mixed[first:last] = (shares @ values[:, start:end]).transpose(1, 0, 2)
            start, first = end, last
        y = self._join(snap(mixed.reshape(len(x), width)))
        y += x
        x = self._attended(y)
        y = self._narrow(self._bend(self._wide(x)))
        y += x
        return self._done(y)


class Engine:
    """A network that answers (b,) records of TOKENS (SIGN_TOKENS, where it reads signs) with (b,) of PLAN.

    Raises KeyError or ValueError for weights that are not of a network of that size.
    """

    def __init__(self, size: str, weights: Mapping[str, npt.NDArray[Any]]) -> None:
        extents, of = SIZES[size], Parameters(weights)
        self._reads_signs = "speed_token" in weights
        self._queries = of.take("queries").astype(np.float64)
        self._route, self._limits = (self._entry(*of.linear(name)) for name in ("route", "limits"))
        self._objects = self._of_classes(of, "objects")
        self._patch = ResidualPatch(of, len(extents.patch)) if extents.patch else TiledPatch(of)
        norm = 1.001 * _LONGEST
        if self._reads_signs:
            self._ways, self._signs = self._entry(*of.linear("ways")), self._of_classes(of, "signs")
            self._held = [self._of_classes(of, f"held.{k}") for k in range(at.HELD)]
            self._speed_token = of.take("speed_token").astype(np.float64)[None]
        self._layers: list[Layer] = []
        for k in range(extents.layers):
            self._layers.append(Layer(of, f"encoder.layers.{k}", extents.heads, norm))
            norm = self._layers[-1].norm
        self._path, self._waypoints, self._speed = (
            Head(of, f"{name}_head", norm) for name in ("path", "waypoint", "speed")
        )
        if self._reads_signs:
            weight, bias = of.linear("ego_speed_head")
            self._ego_speed = Linear(weight, bias, bound=norm, norm=norm, snapped=None)
        of.end(("forecast_head",))
        # Arrays that do not fit each other show here, not in an episode.
        self(np.zeros(1, dtype=self.inputs))

    @property
    def inputs(self) -> np.dtype[Any]:
        return at.SIGN_TOKENS if self._reads_signs else at.TOKENS

    def __call__(self, records: at.Records) -> at.Records:
        x, ends = self._embed(records)
        first = np.array([0, *ends[:-1]])
        asked = QUERIES + self._reads_signs
        # The queries come first, and then the speed token.
        kept = (first[:, None] + np.arange(asked)).ravel()
        for layer in self._layers[:-1]:
            x = layer(x, ends)
        x = self._layers[-1](x, ends, kept)
        target = self._ego_speed(x[QUERIES::asked]) if self._reads_signs else self._speed(x[SPEED::asked])
        return plans(self._path(x[PATH::asked]), self._waypoints(x[WAYPOINT::asked]), target)

    @staticmethod
    def _entry(weight: Array, bias: Array) -> Linear:
        return Linear(weight, bias, bound=_MOST, snapped=None)

    @classmethod
    def _of_classes(cls, of: Parameters, name: str) -> Linear:
        """One product for all classes: each token's features stand in the columns of its class, whose last is 1."""
        weight, bias = of.take(f"{name}.weight"), of.take(f"{name}.bias")
        table = np.concatenate([weight, bias[:, None]], axis=1).reshape(-1, weight.shape[-1])
        return cls._entry(table.T, np.zeros(weight.shape[-1]))

    def _embed(self, records: at.Records) -> tuple[Array, list[int]]:
        """(n, width) tokens of one record after the other, and where each record's end."""
        b = len(records)
        there = records["kinds"] != at.EMPTY
        seen = [
            [self._queries] * b,
            self._route(_cut(records["route"].reshape(b, -1)))[:, None],
            self._limits(_cut(records["limits"]))[:, None],
            self._patch(records["patch"])[:, None],
            _split(self._objects(_spread(records["objects"], records["kinds"], self._objects)), there),
        ]
        if self._reads_signs:
            classes, known = records["sign_classes"], records["way_known"] != 0
            holding = records["held_classes"]
            seen[1:1] = [
                [self._speed_token] * b,
                *(
                    _split(
                        held(_spread(records["held"][:, k : k + 1], holding[:, k : k + 1], held)),
                        holding[:, k : k + 1] != at.EMPTY,
                    )
                    for k, held in enumerate(self._held)
                ),
                _split(self._signs(_spread(records["signs"], classes, self._signs)), classes != at.EMPTY),
                _split(self._ways(_cut(records["ways"][known])), known),
            ]
        x = np.concatenate([part for row in zip(*seen, strict=True) for part in row])
        x *= _LONGEST / np.maximum(np.sqrt(tree_sum(x * x)), _LONGEST)
        return snap(x), np.cumsum([sum(map(len, row)) for row in zip(*seen, strict=True)]).tolist()


def plans(steps: Array, waypoint_steps: Array, logits: Array) -> at.Records:
    """(b,) of PLAN from steps along path and waypoints, (b, 2 k) m, and the logits of the speed classes."""
    answers: at.Records = np.empty(len(logits), dtype=at.PLAN)
    answers["path"] = steps.reshape(-1, at.PATH_POINTS, 2).cumsum(axis=1)
    answers["waypoints"] = waypoint_steps.reshape(-1, at.WAYPOINTS, 2).cumsum(axis=1)
    answers["speed"], answers["standing"] = target_speed_of(logits)
    return answers


def target_speed_of(logits: Array) -> tuple[Array, Array]:
    """The mean of the speed classes, m/s, and the share of standing: of (..., 8) logits."""
    weight = exp(logits - logits.max(axis=-1, keepdims=True))
    total = tree_sum(weight)[..., 0]
    return tree_sum(weight * _SPEEDS)[..., 0] / total, weight[..., 0] / total


def _cut(features: npt.NDArray[np.floating]) -> Array:
    return snap(np.clip(features.astype(np.float64), -_MOST, _MOST))


def _spread(features: npt.NDArray[np.float32], kinds: npt.NDArray[np.uint8], table: Linear) -> Array:
    """(b, k, f) features of tokens with a class to (n, classes x (f + 1)) rows, zero but for their class's part."""
    there = kinds != at.EMPTY
    own, chosen = _cut(features[there]), kinds[there].astype(np.intp) - 1
    wide, each = table.weight.shape[1], own.shape[1] + 1
    rows = np.zeros((len(own), wide // each, each))
    rows[np.arange(len(own)), chosen, :-1] = own
    rows[np.arange(len(own)), chosen, -1] = 1.0
    return rows.reshape(len(own), wide)


def _split(tokens: Array, there: npt.NDArray[np.bool_]) -> list[Array]:
    """Tokens of all records as those of each. there: (b, k) whether a record has its k-th."""
    return np.split(tokens, np.cumsum(there.sum(axis=1))[:-1])
