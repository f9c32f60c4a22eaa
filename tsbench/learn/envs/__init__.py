"""Gymnasium environments: importing this package registers `tsbench/Drive-v1`,
and `tsbench/Priority-v1` and the like for the types of one group.

Or let Gymnasium import it, in worker processes too: `gymnasium.make("tsbench.learn.envs:tsbench/Drive-v1")`.
`-v0` is the same environment with the defaults that `ppo` learned with: it shows no plate, and violations are free.
"""

from __future__ import annotations

from tsbench.core.errors import missing_extra
from tsbench.learn.envs.reward import SIGNS
from tsbench.learn.rl.actions import action_for

try:
    import gymnasium
except ModuleNotFoundError as problem:
    # Python shows where an error came from as well; what it says is one line with the command that helps.
    raise ModuleNotFoundError(str(missing_extra(problem) or problem), name=problem.name) from None

__all__ = ["DRIVE", "DRIVE_V0", "GROUPS", "MAX_STEPS", "action_for"]

DRIVE, DRIVE_V0 = "tsbench/Drive-v1", "tsbench/Drive-v0"

GROUPS = {f"tsbench/{group.title()}-v1": group for group in ("priority", "speed", "obstacles", "routing")}

# Ticks of the longest horizon, and one: what is too late ends as a failure before this cuts it short.
MAX_STEPS = 1001
# Defaults by version. The later one shows all that a sign asks for, its actions can do it, and its reward wants it.
_DEFAULTS: dict[str, dict[str, object]] = {
    "v0": {"observation": "vector", "action": "aim"},
    "v1": {"observation": "scene", "action": "exit", "reward": SIGNS},
}


for _name, _types in {DRIVE: None, **GROUPS}.items():
    for _version, _defaults in _DEFAULTS.items():
        _versioned = _name.replace("-v1", f"-{_version}")
        if _versioned not in gymnasium.registry:
            gymnasium.register(
                _versioned,
                entry_point="tsbench.learn.envs.drive_env:DriveEnv",
                vector_entry_point="tsbench.learn.envs.drive_env:drive_in_processes",
                max_episode_steps=MAX_STEPS,
                kwargs={"types": _types, **_defaults},
            )
