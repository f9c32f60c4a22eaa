"""Exits onto one-way roads (5.7): turns that the sign allows; lanes are the route's business."""

from __future__ import annotations

from tsbench.planners.experts.rules.manoeuvre_constraint import ManoeuvreConstraint


class OneWayExitConstraint(ManoeuvreConstraint):
    """As where a manoeuvre is prescribed."""
