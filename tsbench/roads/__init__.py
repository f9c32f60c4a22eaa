"""Roads as planners and rules see them: paths through junctions, their conflicts, the vehicles on them."""
