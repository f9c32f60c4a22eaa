"""`ppo`: an MLP on 275 numbers, learned by PPO."""
