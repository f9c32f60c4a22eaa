"""Quantiles of densities that actions are drawn from, with the same bits on every CPU."""

from __future__ import annotations

import numpy as np

from tsbench.geometry.elementary import Array, exp_of, log, log_of, polynomial

# Wichura (1988), algorithm AS 241: numerators and denominators for the middle, the flanks and the tails.
_MIDDLE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4, 4.5921953931549871457e4,
     1.3731693765509461125e4, 1.9715909503065514427e3, 1.3314166789178437745e2, 3.3871328727963666080e0),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4, 2.1213794301586595867e4,
     5.3941960214247511077e3, 6.8718700749205790830e2, 4.2313330701600911252e1, 1.0),
)  # fmt: skip
_FLANKS = (
    (7.7454501427834140764e-4, 2.27238449892691845833e-2, 2.41780725177450611770e-1, 1.27045825245236838258e0,
     3.64784832476320460504e0, 5.76949722146069140550e0, 4.63033784615654529590e0, 1.42343711074968357734e0),
    (1.05075007164441684324e-9, 5.4759380849953449460e-4, 1.51986665636164571966e-2, 1.48103976427480074590e-1,
     6.8976733498510000455e-1, 1.67638483018380384940e0, 2.05319162663775882187e0, 1.0),
)  # fmt: skip
_TAILS = (
    (2.01033439929228813265e-7, 2.71155556874348757815e-5, 1.24266094738807843860e-3, 2.65321895265761230930e-2,
     2.96560571828504891230e-1, 1.78482653991729133580e0, 5.46378491116411436990e0, 6.65790464350110377720e0),
    (2.04426310338993978564e-15, 1.42151175831644588870e-7, 1.84631831751005468180e-5, 7.86869131145613259100e-4,
     1.48753612908506148525e-2, 1.36929880922735805310e-1, 5.99832206555887937690e-1, 1.0),
)  # fmt: skip
_MIDDLE_HALF, _MIDDLE_SQUARE, _FLANK_ENDS = 0.425, 0.180625, 5.0
# Far more than any quantile or continued fraction here has taken.
_ROUNDS, _TERMS = 100, 1000
_CLOSE = 1e-12


def normal_quantile(p: Array) -> Array:
    """Of the standard normal distribution, for p between 0 and 1; to 1e-15."""
    q = p - 0.5
    middle = _MIDDLE_SQUARE - q * q
    near = q * (polynomial(middle, _MIDDLE[0]) / polynomial(middle, _MIDDLE[1]))
    r = np.sqrt(-log(np.where(q <= 0.0, p, 1.0 - p)))
    flank, tail = r - 1.6, r - _FLANK_ENDS
    far = np.where(
        r <= _FLANK_ENDS,
        polynomial(flank, _FLANKS[0]) / polynomial(flank, _FLANKS[1]),
        polynomial(tail, _TAILS[0]) / polynomial(tail, _TAILS[1]),
    )
    return np.where(np.abs(q) <= _MIDDLE_HALF, near, np.copysign(far, q))


def beta_quantile(a: float, b: float, p: float) -> float:
    """Of the Beta distribution with parameters above 0, for p between 0 and 1; to 1e-11."""
    edge = (a + 1.0) / (a + b + 2.0)
    # Both sides' shares make 1: that gives the constant without a gamma function.
    whole = _power(a, b, edge) * (_fraction(a, b, edge) / a + _fraction(b, a, 1.0 - edge) / b)
    low, high, x = 0.0, 1.0, edge
    for _ in range(_ROUNDS):
        density = _power(a, b, x) / whole
        below = density * _fraction(a, b, x) / a if x <= edge else 1.0 - density * _fraction(b, a, 1.0 - x) / b
        if below > p:
            high = x
        else:
            low = x
        # Newton's step, where it stays between the bounds.
        new = x - (below - p) * x * (1.0 - x) / density
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) < _CLOSE:
            return new
        x = new
    return x


def _power(a: float, b: float, x: float) -> float:
    return exp_of(a * log_of(x) + b * log_of(1.0 - x))


def _fraction(a: float, b: float, x: float) -> float:
    """The continued fraction of the incomplete Beta function (DLMF 8.17.22, by Lentz), for x up to `edge` above."""
    c, d = 1.0, 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    value = d
    for m in range(1, _TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        value *= c * d
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        change = c * d
        value *= change
        if abs(change - 1.0) < _CLOSE:
            return value
    raise ArithmeticError(f"the Beta distribution of {a}, {b} does not converge")
