"""A planner in a process of its own, out of reach of the referee: protocol, sandbox, and both ends of the line."""
