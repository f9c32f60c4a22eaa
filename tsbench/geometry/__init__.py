"""Polylines, Frenet frames, footprints and overlap: pure functions on arrays."""
