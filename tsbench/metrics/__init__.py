"""Metrics per episode, aggregation and intervals."""
