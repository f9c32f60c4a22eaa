"""Reinforcement learning of `ppo` and `carl`."""
