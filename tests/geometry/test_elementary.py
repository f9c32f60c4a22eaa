"""Elementary functions from basic operations: as accurate as the C library's."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import ndtr

from tsbench.geometry import elementary

X = np.random.default_rng(3).normal(scale=8.0, size=20_000)
Y = np.random.default_rng(4).normal(scale=8.0, size=20_000)


def places(found: np.ndarray, wanted: np.ndarray) -> float:
    """Greatest error in units of the last place."""
    return float((np.abs(found - wanted) / np.spacing(np.abs(wanted))).max())


def test_arctan2() -> None:
    wanted = np.array([math.atan2(y, x) for y, x in zip(Y.tolist(), X.tolist(), strict=True)])
    assert places(elementary.arctan2(Y, X), wanted) <= 3.0
    for y in (-1.0, -0.0, 0.0, 1.0):
        for x in (-1.0, 1.0):
            assert float(elementary.arctan2(np.array(y), np.array(x))) == math.atan2(y, x)
    assert float(elementary.arctan2(np.array(1.0), np.array(0.0))) == math.pi / 2


@pytest.mark.parametrize(("mine", "its", "x"), [(elementary.exp, np.exp, 5 * X), (elementary.log, np.log, np.abs(X))])
def test_exp_and_log(mine: Callable[..., np.ndarray], its: Callable[..., np.ndarray], x: np.ndarray) -> None:
    assert places(mine(x), its(x)) <= 4.0
    one = elementary.exp_of if mine is elementary.exp else elementary.log_of
    assert [one(value) for value in x[:500].tolist()] == mine(x[:500]).tolist()


def test_what_is_beyond_is_cut() -> None:
    assert elementary.exp(np.array([-1e9, 1e9])).tolist() == elementary.exp(np.array([-700.0, 700.0])).tolist()


def test_tanh_and_the_normal_distribution() -> None:
    assert np.abs(elementary.tanh(X) - np.tanh(X)).max() < 1e-15
    assert np.abs(elementary.normal_share(X) - ndtr(X)).max() < 2e-15
    assert np.allclose(elementary.normal_density(X), np.exp(-X * X / 2) / math.sqrt(2 * math.pi), rtol=1e-13, atol=0)
