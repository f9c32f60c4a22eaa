"""Gymnasium environments: importing this package registers `tsbench/Drive-v0`.

Or let Gymnasium import it, which also works in worker processes: `gymnasium.make("tsbench.envs:tsbench/Drive-v0")`.
"""

from __future__ import annotations

import gymnasium

DRIVE = "tsbench/Drive-v0"

if DRIVE not in gymnasium.registry:
    gymnasium.register(DRIVE, entry_point="tsbench.envs.drive:DriveEnv")
