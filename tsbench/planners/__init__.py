"""The planner contract and the planners."""
