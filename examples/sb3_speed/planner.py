"""A policy of Stable-Baselines3 (PPO or A2C) that sees `plates` and acts by `cruise`.

`tsbench planners from-sb3` wrote this; `policy.json` says from what.
"""

from pathlib import Path
from typing import ClassVar

from tsbench.bridges.sb3 import Sb3Planner


class Policy(Sb3Planner):
    """`tsbench run --planner planner.py:Policy`."""

    sign_access = True
    chooses_route = False
    folder: ClassVar[Path] = Path(__file__).parent
    # Named here, they count with this planner's code.
    files = ("policy.json", "policy.safetensors")
