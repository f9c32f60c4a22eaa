"""Exact sums: whatever the order in which a product is added up, the bits are the same; and near to float64's."""

from __future__ import annotations

import math
from fractions import Fraction

import cv2
import numpy as np
import pytest
from scipy.special import betaincinv, erf, ndtri

from tsbench.learn.fixed_point import (
    BITS,
    Convolution,
    GroupNorm,
    LayerNorm,
    Linear,
    gelu,
    row_sums,
    snap,
    softmax,
    tanh,
    tree_sum,
)
from tsbench.learn.rl.actions import beta_quantile, normal_quantile
from tsbench.learn.shared_inputs import cut, pack, repack

RNG = np.random.default_rng(7)


def test_a_product_is_the_exact_sum() -> None:
    weight, bias = RNG.normal(scale=0.3, size=(9, 300)), RNG.normal(size=9)
    linear = Linear(weight, bias, bound=8.0, snapped=None)
    x = snap(RNG.uniform(-8.0, 8.0, (5, 300)))
    sums = x @ linear.weight.T
    for row, values in zip(sums, x, strict=True):
        for found, w in zip(row.tolist(), linear.weight, strict=True):
            exact = sum(Fraction(a) * Fraction(b) for a, b in zip(w.tolist(), values.tolist(), strict=True))
            assert Fraction(found) == exact
    order = RNG.permutation(300)
    assert (x[:, order] @ linear.weight[:, order].T).tobytes() == sums.tobytes()
    assert np.abs(linear(x) - (x @ weight.T + bias)).max() < 1e-4
    assert np.abs(linear(x)).max() <= linear.bound


def test_the_worst_input_is_still_exact() -> None:
    """All of one sign, at the bound: the largest sum that the grids are made for."""
    weight = RNG.uniform(0.2, 1.0, (1, 500))
    linear = Linear(weight, np.zeros(1), bound=16.0, snapped=None)
    x = np.full((1, 500), 16.0)
    x[0, ::2] -= 2.0**-BITS
    exact = sum(Fraction(a) * Fraction(b) for a, b in zip(x[0].tolist(), linear.weight[0].tolist(), strict=True))
    assert Fraction(float((x @ linear.weight.T)[0, 0])) == exact


@pytest.mark.parametrize("weight", [np.full((2, 3), 1e9), np.full((2, 3), np.nan), np.full((2, 3), np.inf)])
def test_weights_without_exact_sums_are_refused(weight: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"too large|no finite"):
        Linear(weight, np.zeros(2), bound=8.0)


def test_outputs_are_multiples() -> None:
    linear = Linear(RNG.normal(size=(4, 6)), RNG.normal(size=4), bound=4.0, snapped=10)
    y = linear(snap(RNG.uniform(-4.0, 4.0, (8, 6)))) * 2.0**10
    assert (y == np.rint(y)).all()


def test_curves() -> None:
    x = RNG.uniform(-11.9, 11.9, 20_000)
    assert np.abs(gelu(12)(x.copy()) - 0.5 * x * (1.0 + erf(x / np.sqrt(2.0)))).max() < 1e-6
    assert np.abs(tanh(3.0 * x) - np.tanh(3.0 * x)).max() < 1e-6
    scores = RNG.normal(scale=4.0, size=(3, 5, 40))
    wanted = np.exp(scores - scores.max(0))
    wanted /= wanted.sum(0)
    assert np.abs(softmax(scores, 24) - wanted).max() < 3e-7


@pytest.mark.slow
def test_normalisations_are_those_of_torch() -> None:
    import torch

    weight, bias = RNG.uniform(0.5, 1.5, 128).astype(np.float32), RNG.normal(size=128).astype(np.float32)
    x = RNG.normal(scale=3.0, size=(7, 128))
    wanted = torch.nn.functional.layer_norm(
        torch.from_numpy(x), (128,), torch.from_numpy(weight).double(), torch.from_numpy(bias).double()
    )
    found = LayerNorm(weight, bias)(x.copy())
    assert np.abs(found - wanted.numpy()).max() < 1e-6
    assert np.sqrt(np.square(found).sum(axis=1)).max() <= LayerNorm(weight, bias).norm
    pictures = RNG.normal(size=(2, 16, 8, 128))
    channels_first = torch.from_numpy(np.ascontiguousarray(pictures.transpose(0, 3, 1, 2)))
    wanted = torch.nn.functional.group_norm(
        channels_first, 8, torch.from_numpy(weight).double(), torch.from_numpy(bias).double()
    )
    assert np.abs(GroupNorm(weight, bias, 128)(pictures) - wanted.numpy().transpose(0, 2, 3, 1)).max() < 1e-6


def test_a_sum_by_halves() -> None:
    x = RNG.normal(size=(3, 64))
    assert np.allclose(tree_sum(x)[:, 0], x.sum(axis=1))
    assert row_sums(x).tobytes() == tree_sum(x).tobytes()


@pytest.mark.parametrize("outputs", [600, 640])
def test_rows_have_their_bits_in_any_company(outputs: int) -> None:
    """Also where outputs are done in several blocks, and some of the outputs alone."""
    snapped = np.repeat([12.0, 20.0], outputs // 2)
    weight, bias = RNG.normal(scale=0.1, size=(outputs, 128)), RNG.normal(size=outputs)
    linear = Linear(weight, bias, bound=8.0, snapped=snapped)
    assert np.abs(linear.weight - weight).max() < 1e-6
    x = snap(RNG.uniform(-8.0, 8.0, (40, 128)))
    rows = linear(x)
    assert rows.tobytes() == np.concatenate([linear(row) for row in x]).tobytes()
    some = linear.part(slice(250, 400))(x)
    assert some.tobytes() == np.ascontiguousarray(rows[:, 250:400]).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(("size", "stride", "pad"), [(8, 4, 0), (4, 2, 0), (3, 2, 0), (3, 1, 1), (7, 2, 3), (1, 2, 0)])
def test_convolutions_are_those_of_torch(size: int, stride: int, pad: int) -> None:
    import torch

    weight, bias = RNG.normal(scale=0.1, size=(6, 5, size, size)), RNG.normal(size=6)
    x = snap(RNG.uniform(-1.0, 1.0, (2, 31, 22, 5)))
    found = Convolution(weight, bias, stride, pad, bound=1.0)(x)
    wanted = torch.nn.functional.conv2d(
        torch.from_numpy(np.ascontiguousarray(x.transpose(0, 3, 1, 2))), torch.from_numpy(weight),
        torch.from_numpy(bias), stride=stride, padding=pad,
    )  # fmt: skip
    assert np.abs(found - wanted.numpy().transpose(0, 2, 3, 1)).max() < 1e-5


def test_quantiles() -> None:
    p = np.concatenate([RNG.random(5000), 10.0 ** -RNG.uniform(1.0, 16.0, 500)])
    assert np.abs(normal_quantile(p) - ndtri(p)).max() < 1e-13
    a, b, p = (RNG.uniform(1.0, 40.0, 300), RNG.uniform(1.0, 40.0, 300), RNG.random(300))
    found = [beta_quantile(*three) for three in zip(a.tolist(), b.tolist(), p.tolist(), strict=True)]
    assert np.abs(found - betaincinv(a, b, p)).max() < 1e-10


def drawing(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (90, 70), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2.0)


def test_it_is_opencvs_cut_out() -> None:
    channels = [drawing(seed) for seed in range(4)]
    packed = pack(channels)
    inside = 0
    for _ in range(40):
        angle, (x, y) = RNG.uniform(-3.0, 3.0), RNG.uniform(-60.0, 150.0, 2)
        c, s = math.cos(angle), math.sin(angle)
        matrix = np.array([[c, -s, x], [s, c, y]])
        found = cut(packed, matrix, 4, 32, 48)
        for mine, channel in zip(found, channels, strict=True):
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            its = cv2.warpAffine(channel, matrix, (48, 32), flags=flags)
            assert np.abs(mine.astype(int) - its).max() <= 2
            inside += int((its > 0).sum())
    assert inside > 10_000


def test_a_channel_is_replaced_and_the_others_are_not() -> None:
    channels = [drawing(seed) for seed in range(3)]
    packed, other = pack(channels), drawing(9)
    repack(packed, 1, other)
    assert packed.tobytes() == pack([channels[0], other, channels[2]]).tobytes()


def test_whole_pixels_are_themselves_and_outside_is_nothing() -> None:
    channel = drawing(1)
    packed = pack([channel])
    still = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 5.0]])
    assert (cut(packed, still, 1, 20, 30)[0] == channel[5:25, 3:33]).all()
    for x, y in ((-1e6, 0.0), (1e6, 0.0), (0.0, -1e6), (0.0, 1e6)):
        assert not cut(packed, np.array([[1.0, 0.0, x], [0.0, 1.0, y]]), 1, 20, 30).any()
