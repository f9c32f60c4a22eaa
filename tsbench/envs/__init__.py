"""Gymnasium environments: importing this package registers `tsbench/Drive-v0`,
and `tsbench/Priority-v0` and the like for the types of one group.

Or let Gymnasium import it, which also works in worker processes: `gymnasium.make("tsbench.envs:tsbench/Drive-v0")`.
"""

from __future__ import annotations

import gymnasium

DRIVE = "tsbench/Drive-v0"

GROUPS = {f"tsbench/{group.title()}-v0": group for group in ("priority", "speed", "obstacles", "routing")}

if DRIVE not in gymnasium.registry:
    gymnasium.register(DRIVE, entry_point="tsbench.envs.drive:DriveEnv")
for _name, _group in GROUPS.items():
    if _name not in gymnasium.registry:
        gymnasium.register(_name, entry_point="tsbench.envs.drive:DriveEnv", kwargs={"types": _group})
