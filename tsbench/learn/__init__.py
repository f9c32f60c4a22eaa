"""Planners that learn: networks, the Gymnasium environment, the oracle, and training on the train split."""
