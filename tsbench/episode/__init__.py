"""One episode: the closed loop of simulation, planner and monitors."""
