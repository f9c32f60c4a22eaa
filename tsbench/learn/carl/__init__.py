"""`carl`: a small CNN on a bird's-eye raster, learned by PPO with the reward of CaRL."""
