"""Training of the learned planners, on the train split."""
