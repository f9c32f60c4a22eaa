"""Placements: how a type's scene is laid out on a map of its family, and where each plate stands."""
