"""Functions with the same bits on every CPU, for float64 arrays and numbers: NumPy's own choose their code by the CPU.

They use additions, multiplications, divisions and comparisons alone. IEEE 754 rounds each of these in one way, and
NumPy never contracts them. Accurate to a few units in the last place.

Angles counter-clockwise from +x, and the classes of turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Number = TypeVar("Number", float, Array)

# Cephes (Moshier), atan.c and exp.c.
_ATAN_P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_ATAN_Q = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
_EXP_P = (1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1)
_EXP_Q = (3.00198505138664455042e-6, 2.52448340349684104192e-3, 2.27265548208155028766e-1, 2.00000000000000000005e0)
_LN2_HIGH, _LN2_LOW = 6.93145751953125e-1, 1.42860682030941723212e-6
_LOG2_E = 1.4426950408889634073599
_EXP_MOST = 700.0
# 2 atanh(s) = s (2 + 2 s^2 / 3 + 2 s^4 / 5 + ...), for s below 0.172.
_ATANH = tuple(2.0 / (2 * k + 1) for k in range(11, -1, -1))
# Half of what pi / 2 is more than its float64.
_PI_4_LOW = 3.061616997868383e-17
_SERIES_TERMS, _TAIL = 140, 8.0


TAU = 2.0 * math.pi

STRAIGHT, LEFT, RIGHT, U_TURN = TURNS = ("straight", "left", "right", "u_turn")
# SUMO's words for them, in a connection's `dir`; T is a U-turn where traffic keeps to the left.
SUMO_TURNS = {"s": STRAIGHT, "l": LEFT, "L": LEFT, "r": RIGHT, "R": RIGHT, "t": U_TURN, "T": U_TURN}
# Of maps and traffic, where no plate says otherwise: rules have their own two bounds in the catalogue.
STRAIGHT_DEG, U_TURN_DEG = 35.0, 145.0


def polynomial(x: Number, coefficients: Sequence[float]) -> Number:
    """The highest power first; at least two coefficients."""
    value = coefficients[0] * x + coefficients[1]
    for c in coefficients[2:]:
        value = value * x + c
    return value


def arctan2(y: Array, x: Array) -> Array:
    """The angle of (x, y), rad in [-pi, pi]; 0 for (0, 0)."""
    ax, ay = np.abs(x), np.abs(y)
    low, high = np.minimum(ax, ay), np.maximum(ax, ay)
    share = low / np.where(high > 0.0, high, 1.0)
    steep = share > 0.66
    t = np.where(steep, (share - 1.0) / (share + 1.0), share)
    z = t * t
    angle = t + t * (z * polynomial(z, _ATAN_P) / polynomial(z, _ATAN_Q))
    angle = np.where(steep, math.pi / 4 + (angle + _PI_4_LOW), angle)
    angle = np.where(ay > ax, math.pi / 2 - angle, angle)
    angle = np.where(x < 0.0, math.pi - angle, angle)
    return np.copysign(angle, y)


def exp(x: Array) -> Array:
    """e to the power of x, with x clipped to -700..700."""
    x = np.minimum(np.maximum(x, -_EXP_MOST), _EXP_MOST)
    whole = np.rint(x * _LOG2_E)
    rest = x - whole * _LN2_HIGH - whole * _LN2_LOW
    square = rest * rest
    odd = rest * polynomial(square, _EXP_P)
    return np.ldexp(1.0 + 2.0 * (odd / (polynomial(square, _EXP_Q) - odd)), whole.astype(np.int64))


def log(x: Array) -> Array:
    """Of positive numbers."""
    part, power = np.frexp(x)
    small = part < math.sqrt(0.5)
    part, power = np.where(small, 2.0 * part, part), power - small
    s = (part - 1.0) / (part + 1.0)
    return power * _LN2_HIGH + (power * _LN2_LOW + s * polynomial(s * s, _ATANH))


def exp_of(x: float) -> float:
    """As `exp`, of one number."""
    x = min(max(x, -_EXP_MOST), _EXP_MOST)
    whole = round(x * _LOG2_E)
    rest = x - whole * _LN2_HIGH - whole * _LN2_LOW
    square = rest * rest
    odd = rest * polynomial(square, _EXP_P)
    return math.ldexp(1.0 + 2.0 * (odd / (polynomial(square, _EXP_Q) - odd)), whole)


def log_of(x: float) -> float:
    """As `log`, of one number."""
    part, power = math.frexp(x)
    if part < math.sqrt(0.5):
        part, power = 2.0 * part, power - 1
    s = (part - 1.0) / (part + 1.0)
    return power * _LN2_HIGH + (power * _LN2_LOW + s * polynomial(s * s, _ATANH))


def tanh(x: Array) -> Array:
    """By exp; near 0 accurate to 1e-16 and not to its own last place."""
    e = exp(-2.0 * np.abs(x))
    return np.copysign((1.0 - e) / (1.0 + e), x)


def normal_density(x: Array) -> Array:
    """Of the standard normal distribution."""
    return exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)


def normal_share(x: Array) -> Array:
    """The standard normal distribution's share below x, accurate to 1e-15; 0 or 1 beyond -8..8."""
    far = np.minimum(np.abs(x), _TAIL)
    term = far.copy()
    total = far.copy()
    # All terms are positive: nothing cancels.
    for k in range(1, _SERIES_TERMS):
        term = term * (far * far / (2 * k + 1))
        total += term
    half = np.where(far < _TAIL, normal_density(far) * total, 0.5)
    return np.where(x < 0.0, 0.5 - half, 0.5 + half)


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
