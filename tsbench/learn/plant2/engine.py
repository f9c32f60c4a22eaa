"""The network without torch: the same plan, in the same bits, on every CPU and in every batch.

Only tokens that are there are reckoned with, and in the last layer only those whose answers somebody reads: exact sums
make both free of consequences. `Embedding` makes each of a record's parts a row of the encoder's input; the encoders of
the bird's-eye patch are as their torch counterparts, one token each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tsbench.geometry.elementary import exp
from tsbench.geometry.polyline import Array
from tsbench.learn.fixed_point import (
    BITS,
    LARGEST,
    SUM_BITS,
    Convolution,
    Curve,
    Linear,
    Parameters,
    gelu,
    rectified,
    row_sums,
    snap,
    softmax,
    tree_sum,
)
from tsbench.learn.plant2 import tokens as at
from tsbench.learn.plant2.tokens import PATH, QUERIES, SIZES, SPEED, TILE, WAYPOINT

_FULL = 255


class TiledPatchEngine:
    """Each tile on its own, then all together."""

    def __init__(self, of: Parameters) -> None:
        weight, bias = of.linear("patch.each")
        # Pixels are whole numbers: the weights may be so much finer.
        self._each = Linear(weight / np.float64(_FULL), bias, bound=_FULL, bits=0, snapped=None)
        self._bend = gelu(self._each.bound)
        self._out = Linear(*of.linear("patch.out"), bound=self._each.bound, snapped=None)

    def __call__(self, patch: npt.NDArray[np.uint8]) -> Array:
        b, down, across = len(patch), at.PATCH_ROWS // TILE, at.PATCH_COLUMNS // TILE
        # Pixels are moved by eights, which is as many as a tile is wide.
        eights = patch.view(np.uint64).reshape(b, at.PATCH_CHANNELS, down, TILE, across)
        tiles = np.ascontiguousarray(eights.transpose(0, 2, 4, 1, 3)).view(np.uint8)
        rows = tiles.reshape(b * down * across, -1).astype(np.float64)
        return self._out(self._bend(self._each(rows)).reshape(b, -1))


class _Residual:
    """Two convolutions and a way around them."""

    def __init__(self, of: Parameters, name: str, stride: int, area: int) -> None:
        self._first, self._second = (
            _convolution(of, f"{name}.first", stride, 1),
            _convolution(of, f"{name}.second", 1, 1),
        )
        self._first_norm, self._second_norm = (of.group_norm(f"{name}.{k}_norm", area) for k in ("first", "second"))
        self._around = _convolution(of, f"{name}.around", stride, 0) if stride > 1 else None

    def __call__(self, x: Array) -> Array:
        inner = rectified(self._first_norm(self._first(x)))
        return rectified(self._second_norm(self._second(inner)) + (self._around(x) if self._around else x))


class ResidualPatchEngine:
    """A ResNet-18 of so many stages, normalised per sample."""

    def __init__(self, of: Parameters, stages: int) -> None:
        weight = of.take("patch.trunk.0.weight") / np.float64(_FULL)
        area = at.PATCH_ROWS * at.PATCH_COLUMNS // 4
        self._first = Convolution(weight, np.zeros(len(weight)), 2, 3, bound=_FULL, bits=0)
        self._norm = of.group_norm("patch.trunk.1", area)
        self._blocks: list[_Residual] = []
        for k in range(2 * stages):
            stride = 2 - k % 2
            area //= stride * stride
            # Before them stand a convolution, its normalisation and a rectifier.
            self._blocks.append(_Residual(of, f"patch.trunk.{3 + k}", stride, area))
        self._out = Linear(*of.linear("patch.out"), bound=LARGEST, snapped=None)

    def __call__(self, patch: npt.NDArray[np.uint8]) -> Array:
        x = rectified(self._norm(self._first(patch.transpose(0, 2, 3, 1).astype(np.float64))))
        for block in self._blocks:
            x = block(x)
        return self._out(x.transpose(0, 3, 1, 2).reshape(len(x), -1))


def _convolution(of: Parameters, name: str, stride: int, pad: int) -> Convolution:
    weight = of.take(f"{name}.weight")
    return Convolution(weight, np.zeros(len(weight)), stride, pad, bound=LARGEST)


# Inputs beyond are cut, and embedded tokens that are longer are shortened, which bounds all that follows.
_MOST, _LONGEST = 32.0, 64.0
# Features of a token with a class, and a 1 for the bias of its class.
_TOLD = max(at.OBJECT_FEATURES, at.SIGN_FEATURES, at.HELD_FEATURES) + 1


class Embedding:
    """(b,) records to (n, width) tokens of one record after the other, and where each record's end.

    Of each record the queries come first, and then the speed token, where it reads signs; the order of the others has
    no consequences. Attributes: norm: most that a token's Euclidean norm is.
    """

    norm = 1.001 * _LONGEST

    def __init__(self, of: Parameters, patch: Sequence[int], reads_signs: bool) -> None:
        asked, slots = [of.take("queries")], [at.OBJECTS]
        self._route, self._limits = (_entry(*of.linear(name)) for name in ("route", "limits"))
        self._patch = ResidualPatchEngine(of, len(patch)) if patch else TiledPatchEngine(of)
        blocks = [_of_classes(of, "objects")]
        self._reads_signs = reads_signs
        if reads_signs:
            self._ways = _entry(*of.linear("ways"))
            blocks += [_of_classes(of, name) for name in (*(f"held.{k}" for k in range(at.HELD)), "signs")]
            slots += [*[1] * at.HELD, at.SIGNS]
            asked.append(of.take("speed_token")[None])
        self._asked = np.concatenate(asked).astype(np.float64)
        # (classes of all kinds, features, width); where those of each slot begin, as classes count from 1.
        self._blocks = np.concatenate(blocks)
        self._begins = np.repeat(np.cumsum([0, *map(len, blocks[:-1])]) - 1, slots)

    def __call__(self, records: at.Records) -> tuple[Array, list[int]]:
        b = len(records)
        owner = np.arange(b)
        classed, of_classed = self._classed(records)
        parts = [
            (np.concatenate([self._asked] * b), np.repeat(owner, len(self._asked))),
            (self._route(_cut(records["route"].reshape(b, -1))), owner),
            (self._limits(_cut(records["limits"])), owner),
            (self._patch(records["patch"]), owner),
            (classed, of_classed),
        ]
        if self._reads_signs:
            known = records["way_known"] != 0
            parts.append((self._ways(_cut(records["ways"][known])), known.nonzero()[0]))
        x, owners = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        ends = [len(x)]
        if b > 1:
            x, ends = x[np.argsort(owners, kind="stable")], np.cumsum(np.bincount(owners)).tolist()
        x *= _LONGEST / np.maximum(np.sqrt(row_sums(x * x)), _LONGEST)
        return snap(x), ends

    def _classed(self, records: at.Records) -> tuple[Array, npt.NDArray[np.intp]]:
        """(k, width) tokens with a class, each by the weights of its own, and the record of each."""
        features = np.zeros((len(records), len(self._begins), _TOLD))
        classes = records["kinds"]
        features[:, : at.OBJECTS, : at.OBJECT_FEATURES] = records["objects"]
        if self._reads_signs:
            features[:, at.OBJECTS : -at.SIGNS, : at.HELD_FEATURES] = records["held"]
            features[:, -at.SIGNS :, : at.SIGN_FEATURES] = records["signs"]
            classes = np.concatenate((classes, records["held_classes"], records["sign_classes"]), axis=1)
        features[..., -1] = 1.0
        owner, slot = (classes != at.EMPTY).nonzero()
        own = self._blocks.take(self._begins[slot] + classes[owner, slot], axis=0)
        return (_cut(features[owner, slot])[:, None] @ own)[:, 0], owner


def _entry(weight: npt.NDArray[np.floating], bias: npt.NDArray[np.floating]) -> Linear:
    return Linear(weight, bias, bound=_MOST, snapped=None)


def _of_classes(of: Parameters, name: str) -> Array:
    """(classes, _TOLD, width) each class's weights, and its bias last: one grid for all."""
    weight, bias = of.take(f"{name}.weight"), of.take(f"{name}.bias")
    table = np.concatenate([weight, bias[:, None]], axis=1)
    classes, told, width = table.shape
    rounded = _entry(table.reshape(-1, width).T, np.zeros(width)).weight.T.reshape(table.shape)
    blocks = np.zeros((classes, _TOLD, width))
    blocks[:, : told - 1], blocks[:, -1] = rounded[:, :-1], rounded[:, -1]
    return blocks


def _cut(features: npt.NDArray[np.floating]) -> Array:
    wide = features.astype(np.float64)
    return snap(np.minimum(np.maximum(wide, -_MOST, out=wide), _MOST, out=wide))


_SHARE_BITS = 24
_SPEEDS = np.array(at.SPEEDS)


class EngineHead:
    def __init__(self, of: Parameters, name: str, norm: float) -> None:
        self._first = Linear(*of.linear(f"{name}.first"), bound=norm, norm=norm, snapped=None)
        self._bend = gelu(self._first.bound)
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
        """(n, width): tokens of one sample after the other. ends: where each sample's end. kept: whose answers are
        wanted, None for all.
        """
        heads, width = self._heads, self._width
        if kept is None:
            projected, lasts = self._project(x), ends
            queries, told = projected[:, :width], projected[:, width:]
        else:
            told, lasts = self._tell(x), np.searchsorted(kept, ends).tolist()
            x = x.take(kept, axis=0)
            queries = self._ask(x)
        # Each (heads, n, width of a head).
        queries, keys, values = (
            part.reshape(len(part), heads, -1).transpose(1, 0, 2)
            for part in (queries, told[:, :width], told[:, width:])
        )
        mixed = np.empty((len(x), heads, width // heads))
        start = first = 0
        for end, last in zip(ends, lasts, strict=True):
            scores = np.empty((end - start, heads, last - first))
            np.matmul(keys[:, start:end], queries[:, first:last].transpose(0, 2, 1), out=scores.transpose(1, 0, 2))
            shares = softmax(scores, self._share_bits).transpose(1, 2, 0)
            np.matmul(shares, values[:, start:end], out=mixed[first:last].transpose(1, 0, 2))
            start, first = end, last
        y = self._join(snap(mixed.reshape(-1, width)))
        y += x
        x = self._attended(y)
        y = self._narrow(self._bend(self._wide(x)))
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
        speed = self._ego_speed if self._reads_signs else self._speed
        target = speed(x[QUERIES if self._reads_signs else SPEED :: asked])
        return plans(self._path(x[PATH::asked]), self._waypoints(x[WAYPOINT::asked]), target)


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
