"""Drivers that read no plate: what a benchmark of sign reading gives to them is its floor. Source: docs/floor.md."""
