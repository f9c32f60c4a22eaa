"""A planner in a process of its own, out of reach of the referee: its protocol, its cell, and both ends of the line."""
