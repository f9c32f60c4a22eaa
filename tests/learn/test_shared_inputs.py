"""Cut-outs in whole numbers: as OpenCV's, to one step of 255."""

from __future__ import annotations

import math

import cv2
import numpy as np

from tsbench.learn.shared_inputs import cut, pack, repack

RNG = np.random.default_rng(2)


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
