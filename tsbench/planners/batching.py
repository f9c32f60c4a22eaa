"""Planners with a network that answers records: on the CPU, or by torch on another device.

Such a planner turns an observation into a record, has its network answer records with records, and turns the answer
into a command.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from tsbench.core.errors import InputError

DEVICES = ("cpu", "cuda")

Records = npt.NDArray[np.void]
# (b,) records in, (b,) records out; a row's answer does not depend on the other rows, to the bit.
Infer = Callable[[Records], Records]


@runtime_checkable
class Batched(Protocol):
    """What the class of such a planner has besides `reset` and `act`. Its constructor takes `infer`: Infer | None, the
    network that answers its records; None = its network on the CPU.

    inputs: dtype of the records. served_on: devices that its network runs on besides the CPU.
    """

    inputs: ClassVar[np.dtype[Any]]
    served_on: ClassVar[tuple[str, ...]]

    @staticmethod
    def network(device: str) -> Infer:
        """Load the network on `cpu` or a device of `served_on`."""


def check_device(device: str) -> None:
    """Raises InputError where torch does not see the device."""
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: torch sees no CUDA device here")
