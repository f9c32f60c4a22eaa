"""What others made: their planners, driven as they are, their formats, and a second judge."""
