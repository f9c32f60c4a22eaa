"""From Stable-Baselines3's `model.zip` to a folder that holds a planner.

A model is a zip of JSON and of PyTorch's file of tensors. Both can carry pickles, which could run anything: of the JSON
only what stands there as text is read, and the tensors come by PyTorch's reader of plain tensors.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import pickle
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from tsbench.bridges.sb3 import READING, RELU, SCALED, TANH, WEIGHTS, mlp
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.learn.envs.seen_tables import KINDS
from tsbench.learn.rl.actions import EXIT, PLAIN
from tsbench.planners.weights import Network, Tensors, save_weights

# Most that a member may come to, unpacked.
_MOST_BYTES = 256 << 20
_DATA, _POLICY, _VERSION = "data", "policy.pth", "_stable_baselines3_version"
_NAME = re.compile(r"[A-Z][A-Za-z0-9]{0,40}")
# How each family's tensors of what acts begin: hidden layers, the last one. PPO and A2C; SAC; TD3 and DDPG.
_FAMILIES = {
    "PPO or A2C": (r"mlp_extractor\.policy_net\.(\d+)", "action_net"),
    "SAC": (r"actor\.latent_pi\.(\d+)", "actor.mu"),
    "TD3 or DDPG": (r"actor\.mu\.(\d+)", ""),
}
_ON_POLICY = "PPO or A2C"
_PLANNER = '''"""{what}

`tsbench planners from-sb3` wrote this; `policy.json` says from what.
"""

from pathlib import Path
from typing import ClassVar

from tsbench.bridges.sb3 import Sb3Planner


class {name}(Sb3Planner):
    """`tsbench run --planner {file}:{name}`."""

    sign_access = {reads}
    chooses_route = {chooses}
    folder: ClassVar[Path] = Path(__file__).parent
    # Named here, they count with this planner's code.
    files = ("policy.json", "policy.safetensors")
'''


def convert(model: Path, out: Path, *, draws: bool, name: str) -> Network:
    """Write `planner.py`, `policy.json` and `policy.safetensors` below `out`.

    What it sees, how it acts and how long it holds are in its action space, how many frames it sees in that of what it
    observes. draws: actions are drawn from the policy's density, not its mean. name: the planner's class. Raises
    InputError: no model, one that is not a plain MLP, or was not trained in tsbench's environment.
    """
    if not _NAME.fullmatch(name):
        raise InputError(f"--name {name}: expected a class name, such as MyPolicy")
    data, state, version, digest = _read(model)
    with io_errors_as_input_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    family, tensors = _actor(model, state)
    on_policy = family == _ON_POLICY
    if draws and not on_policy:
        raise InputError(f"{model}: --draws is for PPO and A2C; {family} is driven by its mean")
    drive = _drive(model, data)
    observation = drive["observation"]
    frames, axis = _frames(model, data, observation, tensors["hidden.0.weight"].shape[1])
    kind = _activation(model, data, TANH if on_policy else RELU)
    facts: dict[str, Any] = {
        "from": family,
        "file": model.name,
        "sha256": digest,
        "stable_baselines3": version,
        **drive,
        "frames": frames,
        "frames_axis": axis,
        "draws": draws,
        "activation": kind,
        "squashed": not on_policy,
    }
    try:
        mlp(tensors, facts)
    except (KeyError, ValueError) as problem:
        raise InputError(f"{model}: its network cannot be taken ({problem})") from None
    made = save_weights(WEIGHTS, out, tensors, facts)
    told = f"A policy of Stable-Baselines3 ({family}) that sees `{observation}` and acts by `{facts['action']}`."
    reads, chooses = observation in READING, facts["action"] == EXIT
    text = _PLANNER.format(what=told, name=name, file="planner.py", reads=reads, chooses=chooses)
    write_atomic(out / "planner.py", text.encode())
    return made


def _read(model: Path) -> tuple[Mapping[str, Any], Mapping[str, Any], str, str]:
    """The JSON, the tensors, the version of Stable-Baselines3, and the SHA-256 of the file."""
    import torch

    with io_errors_as_input_errors(model):
        content = model.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as parts:
            for part in (_DATA, _POLICY):
                if part not in parts.namelist():
                    raise InputError(f"{model}: no model of Stable-Baselines3 (it has no {part})")
                if parts.getinfo(part).file_size > _MOST_BYTES:
                    raise InputError(f"{model}: {part} is larger than {_MOST_BYTES >> 20} MiB")
            data, raw = json.loads(parts.read(_DATA)), parts.read(_POLICY)
            version = parts.read(_VERSION).decode().strip() if _VERSION in parts.namelist() else "unknown"
        state = torch.load(io.BytesIO(raw), map_location="cpu", weights_only=True)
    except (zipfile.BadZipFile, pickle.UnpicklingError, RuntimeError, ValueError, EOFError) as problem:
        reason = " ".join(f"{type(problem).__name__}: {problem}".split())[:160]
        raise InputError(f"{model}: cannot be read as a model of Stable-Baselines3 ({reason})") from None
    if not isinstance(data, dict) or not isinstance(state, dict):
        raise InputError(f"{model}: no model of Stable-Baselines3 (its parts are of another kind)")
    return data, state, version, hashlib.sha256(content).hexdigest()


def _actor(model: Path, state: Mapping[str, Any]) -> tuple[str, Tensors]:
    """What acts, under the names that the planner loads, and whose family it is."""
    strange = sorted(key for key in state if "features_extractor" in key)
    if strange:
        raise InputError(f"{model}: has a features extractor of its own ({strange[0]}): a plain MLP is needed")
    for family, (hidden, last) in _FAMILIES.items():
        places = sorted({int(found[1]) for key in state if (found := re.match(hidden + r"\.weight$", key))})
        if not places:
            continue
        prefix = hidden.replace("\\", "").removesuffix("(d+)")
        names = [f"{prefix}{k}" for k in places]
        if not last:
            last = names.pop()
        if not names or f"{last}.weight" not in state:
            break
        tensors: Tensors = {}
        for k, name in enumerate(names):
            tensors |= _layer(state, name, f"hidden.{k}")
        tensors |= _layer(state, last, "action")
        actions = len(tensors["action.bias"])
        spread = state.get("log_std")
        if spread is not None and tuple(spread.shape) != (actions,):
            raise InputError(f"{model}: state-dependent exploration (use_sde) is not supported")
        tensors["action.log_std"] = np.zeros(actions, np.float32) if spread is None else spread.numpy()
        return family, tensors
    raise InputError(
        f"{model}: no policy of PPO, A2C, SAC, TD3 or DDPG with hidden layers (it has {', '.join(sorted(state)[:3])})"
    )


def _layer(state: Mapping[str, Any], name: str, new: str) -> Tensors:
    return {f"{new}.{part}": state[f"{name}.{part}"].numpy() for part in ("weight", "bias")}


def _drive(model: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """How the environment was made: observation, action, hold."""
    space = data.get("action_space")
    drive = space.get("drive") if isinstance(space, dict) else None
    if not isinstance(drive, dict):
        raise InputError(
            f"{model}: its action space does not say what it was trained with: train it in tsbench/Drive-v1, without a "
            "wrapper that changes actions"
        )
    seen, action, hold = (drive.get(key) for key in ("observation", "action", "hold"))
    if seen in KINDS and seen not in SCALED:
        raise InputError(f"{model}: policies of `{seen}` cannot be taken; expected one of {', '.join(SCALED)}")
    if seen not in SCALED or action not in (*PLAIN, EXIT) or not isinstance(hold, int) or hold < 1:
        raise InputError(f"{model}: was trained with {drive}, which this version's environment does not have")
    return {"observation": seen, "action": action, "hold": hold}


def _frames(model: Path, data: Mapping[str, Any], seen: str, inputs: int) -> tuple[int, int]:
    """How many observations the network sees at a time, and the axis along which they stand."""
    space: Any = KINDS[seen]().space
    parts: Any = space.values() if isinstance(space, spaces.Dict) else [space]
    own = [part.shape for part in parts]
    size = sum(math.prod(shape) for shape in own)
    told = data.get("observation_space")
    text = str(told.get("spaces") or told.get("_shape")) if isinstance(told, dict) else ""
    shapes = [tuple(map(int, re.findall(r"\d+", found))) for found in re.findall(r"[(\[](\d[\d, ]*)[)\]]", text)]
    frames, left = divmod(inputs, size)
    if not left and frames == 1:
        return 1, -1
    if shapes == [(*shape[:-1], frames * shape[-1]) for shape in own]:
        return frames, -1
    if shapes == [(frames, *shape) for shape in own]:
        return frames, 0
    raise InputError(
        f"{model}: a network of {inputs} inputs: expected {size} (`{seen}`), or what VecFrameStack or "
        "FrameStackObservation make of them"
    )


def _activation(model: Path, data: Mapping[str, Any], default: str) -> str:
    """As the text beside the pickle says; where it says nothing, the algorithm's own."""
    told = data.get("policy_kwargs")
    name = str(told.get("activation_fn", "")) if isinstance(told, dict) else ""
    if not name:
        return default
    for known, word in ((TANH, "Tanh"), (RELU, "ReLU")):
        if re.search(rf"\b{word}\b", name):
            return known
    raise InputError(f"{model}: activation {name}: expected Tanh or ReLU")
