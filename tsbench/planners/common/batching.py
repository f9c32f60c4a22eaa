"""Planners whose network one process can answer for many episodes at once.

Such a planner turns an observation into a record, has its network answer records with records, and turns the answer
into a command; what it remembers of an episode stays with it. So only records travel, and a network is loaded once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

DEVICES = ("cpu", "cuda")

Records = npt.NDArray[np.void]
# (b,) records in, (b,) records out; a row's answer does not depend on the other rows, to the bit.
Infer = Callable[[Records], Records]


@runtime_checkable
class Batched(Protocol):
    """What the class of such a planner has besides `reset` and `act`. Its constructor takes `infer`: Infer | None,
    who answers its records; None = a network of its own on the CPU.

    inputs, outputs: dtypes of the records. served_on: devices on which a batch costs less than its parts.
    """

    inputs: ClassVar[np.dtype[Any]]
    outputs: ClassVar[np.dtype[Any]]
    served_on: ClassVar[tuple[str, ...]]

    @staticmethod
    def network(device: str) -> Infer:
        """Load the network on `cpu` or `cuda`."""


def is_served(planner: object, device: str) -> bool:
    """Is it a class whose network is worth a process of its own on a device?"""
    return isinstance(planner, type) and isinstance(planner, Batched) and device in planner.served_on
