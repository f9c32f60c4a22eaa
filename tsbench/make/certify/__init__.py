"""Proof that a scenario row is what it says."""
