"""The privileged experts: a base planner constrained by what the rule says."""
