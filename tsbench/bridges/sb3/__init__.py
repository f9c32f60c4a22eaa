"""Policies of Stable-Baselines3 that were trained in tsbench's environment, as planners. Nothing is unpickled."""

from tsbench.bridges.sb3.sb3_planner import Sb3Planner

__all__ = ["Sb3Planner"]
