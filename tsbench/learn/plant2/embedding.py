"""The tokens of the engine: each of a record's parts as a column of the encoder's input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.learn.networks.convolution import Parameters
from tsbench.learn.networks.fixed_point import Linear, column_sums, snap
from tsbench.learn.plant2 import layout as at
from tsbench.learn.plant2.engine_patch import ResidualPatchEngine, TiledPatchEngine

# Inputs beyond are cut, and embedded tokens that are longer are shortened, which bounds all that follows.
_MOST, _LONGEST = 32.0, 64.0
# Features of a token with a class, and a 1 for the bias of its class.
_TOLD = max(at.OBJECT_FEATURES, at.SIGN_FEATURES, at.HELD_FEATURES) + 1


class Embedding:
    """(b,) records to (width, n) tokens of one record after the other, and where each record's end.

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
        x = np.ascontiguousarray(x.T)
        x *= _LONGEST / np.maximum(np.sqrt(column_sums(x * x)), _LONGEST)
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
