"""What `ppo` and `carl` share."""
