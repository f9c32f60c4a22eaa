"""Learning from the oracle's drives."""
