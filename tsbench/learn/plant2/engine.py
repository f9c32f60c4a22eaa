"""The network without torch: the same plan, in the same bits, on every CPU and in every batch.

Only tokens that are there are reckoned with, and in the last layer only those whose answers somebody reads: exact sums
make both free of consequences. Tokens are columns: few as they are, products and sums by feature then take half the
time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp
from tsbench.geometry.polyline import Array
from tsbench.learn.networks.convolution import Parameters
from tsbench.learn.networks.fixed_point import BITS, SUM_BITS, Curve, Linear, gelu, snap, softmax, tree_sum
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.embedding import Embedding
from tsbench.learn.plant2.layout import PATH, QUERIES, SIZES, SPEED, WAYPOINT

_SHARE_BITS = 24
_SPEEDS = np.array(at.SPEEDS)


class EngineHead:
    def __init__(self, of: Parameters, name: str, norm: float) -> None:
        self._first = Linear(*of.linear(f"{name}.first"), bound=norm, norm=norm, snapped=None)
        self._bend = gelu(self._first.bound)
        self._second = Linear(*of.linear(f"{name}.second"), bound=self._first.bound, snapped=None)

    def __call__(self, x: Array) -> Array:
        """(width, n) to (out, n)."""
        return self._second.columns(self._bend(self._first.columns(x)))


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
        self._share_bits = min(SUM_BITS - BITS - math.ceil(math.log2(2.0 * max(value_bound, 1.0))), _SHARE_BITS)
        project = Linear(weight, bias, bound=norm, norm=norm, snapped=snapped)
        self._ask, self._tell = project.part(slice(width)), project.part(slice(width, None))
        self._project = project
        self._join = Linear(*of.linear(f"{name}.self_attn.out_proj"), bound=value_bound, snapped=None)
        self._attended, self._done = of.norm(f"{name}.norm1"), of.norm(f"{name}.norm2")
        between = self._attended.norm
        self._wide = Linear(*of.linear(f"{name}.linear1"), bound=between, norm=between, snapped=None)
        self._bend: Curve = gelu(self._wide.bound)
        self._narrow = Linear(*of.linear(f"{name}.linear2"), bound=self._wide.bound, snapped=None)
        self.norm = self._done.norm

    def __call__(self, x: Array, ends: list[int], kept: npt.NDArray[np.intp] | None = None) -> Array:
        """(width, n): tokens of one sample after the other. ends: where each sample's end. kept: whose answers are
        wanted, None for all.
        """
        heads, width = self._heads, self._width
        if kept is None:
            projected, lasts = self._project.columns(x), ends
            queries, told = projected[:width], projected[width:]
        else:
            told, lasts = self._tell.columns(x), np.searchsorted(kept, ends).tolist()
            x = x.take(kept, axis=1)
            queries = self._ask.columns(x)
        # Each (heads, width of a head, n).
        queries = queries.reshape(heads, width // heads, -1)
        keys, values = told.reshape(2, heads, width // heads, -1)
        mixed = np.empty(queries.shape)
        start = first = 0
        for end, last in zip(ends, lasts, strict=True):
            scores = keys[:, :, start:end].transpose(0, 2, 1) @ queries[:, :, first:last]
            np.matmul(values[:, :, start:end], softmax(scores, self._share_bits), out=mixed[:, :, first:last])
            start, first = end, last
        y = self._join.columns(snap(mixed.reshape(width, -1)))
        y += x
        x = self._attended(y)
        y = self._narrow.columns(self._bend(self._wide.columns(x)))
        y += x
        return self._done(y)


class Plant2Engine:
    """A network that answers (b,) records of TOKENS (SIGN_TOKENS, where it reads signs) with (b,) of PLAN.

    Raises KeyError or ValueError for weights that are not of a network of that size.
    """

    def __init__(self, size: str, weights: Mapping[str, npt.NDArray[Any]]) -> None:
        extents, of = SIZES[size], Parameters(weights)
        self._reads_signs = "speed_token" in weights
        self._embed = Embedding(of, extents.patch, self._reads_signs)
        norm = self._embed.norm
        self._layers: list[Layer] = []
        for k in range(extents.layers):
            self._layers.append(Layer(of, f"encoder.layers.{k}", extents.heads, norm))
            norm = self._layers[-1].norm
        self._path, self._waypoints, self._speed = (
            EngineHead(of, f"{name}_head", norm) for name in ("path", "waypoint", "speed")
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
        speed = self._ego_speed.columns if self._reads_signs else self._speed
        target = speed(x[:, QUERIES if self._reads_signs else SPEED :: asked])
        return plans(self._path(x[:, PATH::asked]).T, self._waypoints(x[:, WAYPOINT::asked]).T, target.T)


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
