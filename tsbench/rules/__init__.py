"""One monitor per rule; three-valued verdicts with evidence."""
