"""What answers a planner's records: the engine on a CPU, torch on a GPU."""

from __future__ import annotations

from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.planners.common.batching import Infer
from tsbench.planners.plant2.engine import Engine
from tsbench.planners.weights import load_weights, network


def load(name: str, device: str, folder: Path | None = None) -> Infer:
    """The network that was saved under a name; InputError where its file is not one of `plant2`."""
    size, weights = str(network(name, folder).training.get("size", "")), load_weights(name, folder)
    if device != "cpu":
        from tsbench.planners.plant2.torch_inference import inference, network_of

        return inference(network_of(size, weights, name), device)
    try:
        return Engine(size, weights)
    except (KeyError, ValueError) as error:
        problem = f"{type(error).__name__}: {error}"
        raise InputError(f"weights {name!r}: are not those of a plant2 network ({problem})") from None
