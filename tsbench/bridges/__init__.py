"""Planners that others made, driven as they are: each file says whose it is and what it is shown."""
