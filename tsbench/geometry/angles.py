"""Angles counter-clockwise from +x, and the classes of turns."""

from __future__ import annotations

import math

TAU = 2.0 * math.pi

STRAIGHT, LEFT, RIGHT, U_TURN = TURNS = ("straight", "left", "right", "u_turn")
# SUMO's words for them, in a connection's `dir`; T is a U-turn where traffic keeps to the left.
SUMO_TURNS = {"s": STRAIGHT, "l": LEFT, "L": LEFT, "r": RIGHT, "R": RIGHT, "t": U_TURN, "T": U_TURN}
# Of maps and traffic, where no plate says otherwise: rules have their own two bounds in the catalogue.
STRAIGHT_DEG, U_TURN_DEG = 35.0, 145.0


def wrap(angle: float) -> float:
    """The same angle (rad) in [-pi, pi)."""
    return (angle + math.pi) % TAU - math.pi


def wrap_deg(angle: float) -> float:
    """The same angle (degrees) in (-180, 180]."""
    return 180.0 - (180.0 - angle) % 360.0


def turn_class(change: float, straight: float = STRAIGHT_DEG, u_turn: float = U_TURN_DEG) -> str:
    """One of TURNS for a change of heading (degrees, left positive): straight up to one bound, u_turn from the other.

    Source: docs/rules.md, "Turns and directions".
    """
    change = wrap_deg(change)
    if abs(change) <= straight:
        return STRAIGHT
    if abs(change) >= u_turn:
        return U_TURN
    return LEFT if change > 0.0 else RIGHT
