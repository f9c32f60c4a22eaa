"""Roads as planners and rules see them: paths through junctions, where they conflict, who comes on them."""
