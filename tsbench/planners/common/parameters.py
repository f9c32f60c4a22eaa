"""A network's arrays as its parts take them out; none may be left over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt

from tsbench.planners.common.convolution import GroupNorm
from tsbench.planners.common.fixed_point import LayerNorm

Tensor = npt.NDArray[Any]


class Parameters:
    """Raises KeyError for a name that is not there."""

    def __init__(self, weights: Mapping[str, Tensor]) -> None:
        self._left = dict(weights)

    def take(self, name: str) -> Tensor:
        return self._left.pop(name)

    def linear(self, name: str) -> tuple[Tensor, Tensor]:
        return self.take(f"{name}.weight"), self.take(f"{name}.bias")

    def norm(self, name: str) -> LayerNorm:
        return LayerNorm(*self.linear(name))

    def group_norm(self, name: str, area: int) -> GroupNorm:
        """A normalisation of pictures of so many pixels."""
        return GroupNorm(*self.linear(name), area)

    def end(self, unused: tuple[str, ...] = ()) -> None:
        """Raises ValueError where something is left but the parts that are not used here."""
        left = sorted(name for name in self._left if name.partition(".")[0] not in unused)
        if left:
            raise ValueError(f"unexpected {', '.join(left)}")
