"""What goes into a page comes out again: as the page's script unpacks it, written here a second time."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path
from typing import Any

import episode_builders as made
import numpy as np
import page_runs
import pytest

from tsbench.core.errors import InputError
from tsbench.episode.perception import SignDetection
from tsbench.episode.trace import read_trace
from tsbench.metrics.interaction import min_ttc
from tsbench.metrics.tracks import tracks_of
from tsbench.report.page.page_format import deltas, pack, pack_table
from tsbench.report.time_to_collision import times_to_collision

EPISODE = ("idm", "speed_limit-m0-v0")


def unpack(content: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    data = gzip.decompress(content)
    (size,) = struct.unpack("<I", data[:4])
    header, at, arrays = json.loads(data[4 : 4 + size]), 4 + size, {}
    for name, kind, length in header["arrays"]:
        if kind == "i8":
            arrays[name] = np.frombuffer(data, np.int8, length, at)
            at += length
        else:
            low = np.frombuffer(data, np.uint8, length, at).astype(np.int16)
            high = np.frombuffer(data, np.int8, length, at + length).astype(np.int16)
            arrays[name], at = low | high << 8, at + 2 * length
    assert at == len(data)
    return header, arrays


def summed(second: np.ndarray, lengths: list[int]) -> np.ndarray:
    values, at = [], 0
    for length in lengths:
        value = step = 0
        for k in range(length):
            if k == 0:
                value = int(second[at])
            else:
                step = int(second[at]) if k == 1 else step + int(second[at])
                value += step
            values.append(value)
            at += 1
    return np.array(values)


def test_arrays_come_back() -> None:
    rng = np.random.default_rng(5)
    wide = rng.integers(-32768, 32767, 99).astype(np.int16)
    small = rng.integers(-128, 127, 7).astype(np.int8)
    header, arrays = unpack(pack({"a": "ü", "n": None}, {"wide": wide, "none": wide[:0], "small": small}))
    assert (header["a"], header["n"]) == ("ü", None)
    assert (arrays["wide"] == wide).all()
    assert (arrays["small"] == small).all()
    assert len(arrays["none"]) == 0
    assert pack({"a": 1}) == pack({"a": 1})
    with pytest.raises(ValueError, match="float64"):
        pack({}, {"x": np.zeros(3)})


@pytest.mark.parametrize("lengths", [[5], [1, 1, 1], [2, 7, 1, 3]])
def test_second_differences_start_anew_in_each_piece(lengths: list[int]) -> None:
    rng = np.random.default_rng(len(lengths))
    values = rng.integers(-3000, 3000, sum(lengths))
    starts = np.cumsum([0, *lengths[:-1]])
    assert (summed(deltas(values, starts), lengths) == values).all()


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="16 bits"):
        deltas(np.array([0, 40_000, 0]), np.array([0]))


def test_a_table_keeps_its_texts_once() -> None:
    columns = ({"name": "a", "label": "a", "kind": "text"}, {"name": "n", "label": "n", "kind": "number"})
    header, _ = unpack(pack_table(columns, {"a": ["x", "y", "x"], "n": [1.0, None, 2.5]}))
    assert header["rows"] == 3
    assert header["values"] == {"a": {"distinct": ["x", "y"], "at": [0, 1, 0]}, "n": [1.0, None, 2.5]}
    with pytest.raises(ValueError, match="rows"):
        pack_table(columns, {"a": ["x"], "n": []})


def test_an_episode_comes_back_within_its_units(tmp_path: Path) -> None:
    path = page_runs.put_trace(tmp_path, *EPISODE)
    packed = page_runs.packer().pack(path, EPISODE)
    header, arrays = unpack(packed.episode)
    trace, units = read_trace(path), header["units"]
    ego = np.array([(s.ego.x, s.ego.y) for s in trace.snapshots])
    for k, axis in enumerate("xy"):
        found = summed(arrays[f"ego_{axis}"], [header["ticks"]]) * units["m"] + header["middle"][k]
        assert np.abs(found - ego[:, k]).max() <= units["m"] / 2 + 1e-9
    assert (summed(arrays["ego_v"], [61]) * units["mps"]).tolist() == pytest.approx([10.0] * 61)
    for name, unit, told in (
        ("a", "mps2", [s.ego.acceleration for s in trace.snapshots]),
        ("steer", "rad", [s.ego.steering for s in trace.snapshots]),
    ):
        found = summed(arrays[f"ego_{name}"], [61]) * units[unit]
        assert np.abs(found - told).max() <= units[unit] / 2 + 1e-9
    lengths = [piece[2] for piece in header["pieces"]]
    x = summed(arrays["actor_x"], lengths) * units["m"] + header["middle"][0]
    h = summed(arrays["actor_h"], lengths) * units["rad"]
    at = 0
    for actor, first, count in header["pieces"]:
        for k in range(count):
            seen = trace.snapshots[first + k].actors
            (row,) = np.flatnonzero(seen.index == actor)
            assert x[at + k] == pytest.approx(seen.pose[row, 0], abs=units["m"])
            assert np.cos(h[at + k] - seen.pose[row, 2]) > 0.999
        at += count
    names = [actor[:2] for actor in header["actors"]]
    assert names == [["car", "car"], ["convoy_0", "convoy"], ["walker", "pedestrian"]]
    # The bus is out of sight for a second: two pieces.
    assert sorted(piece[0] for piece in header["pieces"]) == [0, 1, 1, 2]
    # The bus signals to the middle of the road before it turns round; nobody slows down.
    lights = np.split(arrays["actor_lights"], np.cumsum(lengths)[:-1])
    for (actor, _, _), lit in zip(header["pieces"], lights, strict=True):
        assert set(lit.tolist()) == {1 if names[actor][0] == "convoy_0" else 0}
    assert header["named"] == {"convoy_0": 3.0}
    (event,) = header["events"]
    assert event["sentence"] == page_runs.SENTENCE
    assert (event["value"], event["threshold"], event["unit"], event["target"]) == (54.1, 41.0, "km/h", True)
    assert header["scene"]["areas"]
    assert packed.plates == ("3.24|40",)
    assert unpack(packed.roads)[0]["drawing"]["areas"]


def test_what_was_told_stands_beside_what_stood_there(tmp_path: Path) -> None:
    """A misread limit, a post, a plate that is none; of the scene's one plate, 3.24 with 40."""
    told = (
        SignDetection(10, "post", "plate", "target", "", None, 90.0, -4.8, 20.0, 10.0),
        SignDetection(12, "misread", "plate", "target", "3.24", 70.0, 90.0, -4.8, 18.0, 10.0),
        SignDetection(15, "false", "", "", "2.4", None, 99.0, -4.8, 24.0, 10.0),
    )
    path = page_runs.put_trace(tmp_path, *EPISODE, told=told)
    header, _ = unpack(page_runs.packer().pack(path, EPISODE).episode)
    shown = [(one["kind"], one["told"], one["stood"], one["target"]) for one in header["told"]]
    assert shown == [
        ("post", "", "3.24|40", True),
        ("misread", "3.24|70", "3.24|40", True),
        ("false", "2.4", "", False),
    ]
    assert [one["time"] for one in header["told"]] == [read_trace(path).snapshots[k].time for k in (10, 12, 15)]


def test_the_least_time_to_collision_is_the_metric(tmp_path: Path) -> None:
    """A slower car leads and is gone for two seconds: the curve has a gap there."""
    egos = [made.ego(60.0 + k, speed=10.0) for k in range(61)]
    lead = made.straight(61, 100.0, egos[0].y, 0.0, 5.0)
    lead[20:40] = np.nan
    path = page_runs.put_trace(tmp_path, *EPISODE, made.facts(egos, [made.Track("lead", lead)]))
    header, arrays = unpack(page_runs.packer().pack(path, EPISODE).episode)
    snapshots = read_trace(path).snapshots
    exact = times_to_collision(snapshots)
    assert exact.min() == min_ttc(tracks_of(snapshots))
    packed = summed(arrays["ego_ttc"], [61]) * header["units"]["s"]
    assert np.abs(packed - exact).max() <= header["units"]["s"] / 2 + 1e-9
    met = exact <= header["farthest_s"]
    assert met.tolist() == [not 20 <= tick < 40 for tick in range(61)]
    assert ((packed <= header["farthest_s"]) == met).all()


def test_who_slows_down_has_its_brakes_on(tmp_path: Path) -> None:
    """Ego and leader slow down twice by 3 m/s, in consecutive ticks."""
    gone = np.cumsum(np.repeat((1.0, 0.7, 0.4, 0.4), (20, 1, 1, 20)))
    egos = [made.ego(60.0 + x, speed=10.0 * v) for x, v in zip(gone, np.diff(gone, append=gone[-1] + 0.4), strict=True)]
    lead = made.straight(len(gone), 0.0, -4.8, 0.0, 0.0)
    lead[:, 0] = 100.0 + gone
    path = page_runs.put_trace(tmp_path, *EPISODE, made.facts(egos, [made.Track("lead", lead)]))
    _, arrays = unpack(page_runs.packer().pack(path, EPISODE).episode)
    for name in ("ego_lights", "actor_lights"):
        assert np.flatnonzero(arrays[name]).tolist() == [19, 20], name
        assert set(arrays[name].tolist()) == {0, 4}


def test_a_trace_of_another_episode_is_refused(tmp_path: Path) -> None:
    path = page_runs.put_trace(tmp_path, *EPISODE)
    with pytest.raises(InputError, match="is the trace of idm speed_limit-m0-v0"):
        page_runs.packer().pack(path, ("other", "speed_limit-m0-v0"))
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(InputError, match="cannot be read as a trace"):
        page_runs.packer().pack(path, EPISODE)


def test_plans_come_back_however_far_they_lead(tmp_path: Path) -> None:
    near = np.array([(60.0, -4.0), (75.5, -4.0), (80.0, 2.0)], dtype=np.float32)
    far = np.array([(1e6, -1e6), (-1e6, 1e6), (1e6, -1e6)], dtype=np.float32)
    path = page_runs.put_trace(tmp_path, *EPISODE, plans=(None, near, near[:0], far))
    header, arrays = unpack(page_runs.packer().pack(path, EPISODE).episode)
    assert header["plans"] == [[1, 3], [3, 3]]
    unit = header["units"]["plan"]
    for k, axis in enumerate("xy"):
        found = summed(arrays[f"plan_{axis}"], [3, 3]) * unit + header["middle"][k]
        assert found[:3] == pytest.approx(near[:, k], abs=unit / 2 + 1e-6)
        assert (np.sign(found[3:]) == np.sign(far[:, k])).all()
