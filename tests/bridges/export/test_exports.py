"""Exports, opened by the readers of those who own the formats."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from command_line import in_process, refused
from patience import HANG_S
from run_builders import episode, make_run

from tsbench.bridges.commonroad_lanelets import SIGN_NUMBERS
from tsbench.core.errors import InputError
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import Trace, read_trace, trace_path, write_trace
from tsbench.metrics.tracks import actor_tracks
from tsbench.planners.registry import resolve
from tsbench.report.drawing.road_shapes import road_shapes
from tsbench.report.episode_files import WRITERS, export_kind, make_one
from tsbench.scenarios.certificates import certificates_of
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import load_scene
from tsbench.scenarios.spec import SIGNED
from tsbench.sim.scene import Scene
from tsbench.sim.world import EGO_LENGTH_M, EGO_WIDTH_M

# By type: a driver who violates a sign, or who meets a closed road, a crosswalk or a junction.
DRIVEN = (("speed_limit", "idm"), ("detour_right", "idm-e"), ("crosswalk", "idm-e"), ("yield", "idm-e"))
COMMONROAD = Path(sys.prefix) / "commonroad"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with the traces of four episodes."""
    records = [episode(planner, 0, 0, 0, scenario_id=kind, scenario_type=kind) for kind, planner in DRIVEN]
    folder = make_run(tmp_path_factory.mktemp("made") / "run", records, asked=3)
    rows = DataSet().table("test")
    tempting = {c.scenario_id for c in certificates_of(DataSet()) if c.tempting}
    sim = None
    for kind, planner in DRIVEN:
        spec = next(
            r
            for r in rows
            if r.scenario_type == kind and r.half == SIGNED and r.variant == 2 and r.scenario_id in tempting
        )
        runner = EpisodeRunner(resolve(planner), simulation=sim)
        sim = runner.simulation
        write_trace(trace_path(folder, planner, kind), runner.run(spec))
    return folder


@pytest.fixture(scope="module")
def traces(run: Path) -> list[tuple[Trace, Scene]]:
    found = [read_trace(trace_path(run, planner, kind)) for kind, planner in DRIVEN]
    return [(trace, load_scene(DataSet(), trace.spec)) for trace in found]


@pytest.fixture(scope="module")
def commonroad(run: Path) -> dict[str, Any]:
    """What CommonRoad's reader says of the three."""
    if not COMMONROAD.is_dir():
        pytest.skip(f"CommonRoad's reader is not in {COMMONROAD} (make setup puts it there)")
    files = [make_one(run, f"{planner}/{kind}", export_kind("commonroad"), None) for kind, planner in DRIVEN]
    script = Path(__file__).with_name("read_commonroad.py")
    numbers = ",".join(sorted(set(SIGN_NUMBERS.values())))
    environment = {**os.environ, "PYTHONPATH": str(COMMONROAD), "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, script, numbers, *files], capture_output=True, text=True, env=environment, timeout=HANG_S
    )
    assert done.returncode == 0, done.stderr
    said: dict[str, Any] = json.loads(done.stdout)
    return said


def test_commonroad_reads_the_road_the_drive_and_the_goal(
    commonroad: dict[str, Any], traces: list[tuple[Trace, Scene]]
) -> None:
    for seen, (trace, scene) in zip(commonroad["files"], traces, strict=True):
        assert seen["id"].startswith("ZAM_")
        assert seen["dt"] == 0.1
        assert seen["dangling"] == []
        assert scene.network.lane_index[scene.start.lane] + 1 in seen["start"]
        assert seen["reached"] is (trace.outcome == "arrived")
        ego, last = trace.snapshots[-1].ego, len(trace.snapshots) - 1
        x, y, heading, speed, step = seen["ego"]
        assert (x, y, speed) == pytest.approx((ego.x, ego.y, ego.speed), abs=1e-3)
        assert math.remainder(heading - ego.heading, math.tau) == pytest.approx(0.0, abs=1e-3)
        assert step == last
        tracks = [[t.kind.name.lower(), t.first, t.length, t.width] for t in actor_tracks(trace)]
        assert seen["obstacles"] == [["car", 0, EGO_LENGTH_M, EGO_WIDTH_M], *tracks]
        assert len(seen["static"]) == len(scene.obstacles)
        assert len(seen["signs"]) == len(scene.signs)
        for (_, _, at), sign in zip(seen["signs"], scene.signs, strict=True):
            assert at == pytest.approx((sign.x, sign.y), abs=1e-3)


def test_commonroad_takes_plates_for_what_they_are(commonroad: dict[str, Any]) -> None:
    speed, detour, crosswalk, _ = commonroad["files"]
    values = {name: values for name, values, _ in speed["signs"]}
    assert {"MAX_SPEED", "MAX_SPEED_END"} <= set(values)
    assert 5.0 <= float(values["MAX_SPEED"][0]) <= 25.0  # m/s
    assert detour["signs"][0][0] == "PRESCRIBED_PASSING_RIGHT"
    assert detour["static"][0] in ("constructionZone", "roadBoundary")
    assert crosswalk["signs"][0][0] == "PEDESTRIANS_CROSSING"
    assert "crosswalk" in crosswalk["types"]
    assert sorted({row[0] for row in crosswalk["obstacles"]} & {"pedestrian"}) == ["pedestrian"]
    means = {code: commonroad["numbers"][number] for code, number in SIGN_NUMBERS.items()}
    assert means["2.4"] == "YIELD"
    assert means["4.1.2"] == "TURN_RIGHT_AHEAD"
    assert means["4.1.3"] == "TURN_LEFT_AHEAD"
    assert means["4.2.2"] == "PRESCRIBED_PASSING_LEFT"
    assert means["5.7.1"] == "ONEWAY_RIGHT"
    assert means["5.7.2"] == "ONEWAY_LEFT"
    assert means["5.32"] == "MAX_SPEED_ZONE_END"


def test_commonroad_knows_junctions_lines_and_the_other_direction(
    commonroad: dict[str, Any], traces: list[tuple[Trace, Scene]]
) -> None:
    for seen, (_, scene) in zip(commonroad["files"][:3], traces, strict=False):
        assert seen["intersections"] == []
        assert seen["stops"] == []
        roads = scene.network.edges.values()
        two_way = {(e.source, e.target) for e in roads} & {(e.target, e.source) for e in roads}
        assert bool(seen["opposite"]) <= bool(two_way)
    seen, (_, scene) = commonroad["files"][3], traces[3]
    network, sign = scene.network, scene.target_signs[0]
    junction = network.edges[sign.edge].target
    inward = [e for e in network.edges.values() if not e.internal and e.target == junction]
    (arms,) = seen["intersections"]
    assert sorted(i for arm in arms for i in arm[0]) == sorted(i + 1 for e in inward for i in e.lanes)
    # A lanelet follows on the arm's where the turn leads, and every turn but back is one of the three.
    ahead = {c.via[0] + 1: c.direction for e in inward for i in e.lanes for c in network.outgoing[i] if c.via}
    turns = {way: {i for arm in arms for i in arm[k]} for k, way in ((1, "rR"), (2, "s"), (3, "lL"))}
    for way, found in turns.items():
        assert found == {i for i, direction in ahead.items() if direction in way}
    own = {i + 1 for i in network.edges[sign.edge].lanes}
    lines = {lanelet: (marking, plates) for lanelet, marking, plates in seen["stops"]}
    assert {lines[lanelet] == ("broad_dashed", ["YIELD"]) for lanelet in own} == {True}
    main = {i + 1 for s in scene.signs if s.code == "2.1" for i in network.edges[s.edge].lanes}
    assert main
    assert not main & set(lines)
    # Who is opposite is so in turn, and drives the other way.
    pairs = dict(seen["opposite"])
    assert pairs
    for one, other in pairs.items():
        assert pairs[other] == one
        a, b = (network.edges[network.lanes[i - 1].edge] for i in (one, other))
        assert (a.source, a.target) == (b.target, b.source)


@pytest.mark.slow
def test_mcap_holds_every_tick(run: Path, traces: list[tuple[Trace, Scene]]) -> None:
    from mcap.reader import make_reader

    for (kind, planner), (trace, scene) in zip(DRIVEN, traces, strict=True):
        path = make_one(run, f"{planner}/{kind}", export_kind("mcap"), run / f"{kind}.mcap")
        with path.open("rb") as file:
            reader = make_reader(file)
            messages: dict[str, list[Any]] = {}
            for schema, channel, message, content in _decoded(reader):
                messages.setdefault(channel, []).append((schema, message, content))
            (metadata,) = [m.metadata for m in reader.iter_metadata() if m.name == "tsbench"]
        assert metadata["planner"] == planner
        assert metadata["outcome"] == trace.outcome
        n = len(trace.snapshots)
        assert [len(messages[c]) for c in ("/scene", "/actors", "/tf", "/ego")] == [1, n, n, n]
        assert messages["/actors"][0][0] == "foxglove.SceneUpdate"
        assert [m.log_time for _, m, _ in messages["/actors"]] == [k * 100_000_000 for k in range(n)]

        tick = n // 2
        snapshot = trace.snapshots[tick]
        entities = {e.id: e for e in messages["/actors"][tick][2].entities}
        table = snapshot.actors.table
        assert set(entities) == {"ego", *(table.ids[row] for row in snapshot.actors.index)}
        middle = entities["ego"].cubes[0].pose.position
        assert (middle.x, middle.y) == pytest.approx((snapshot.ego.x, snapshot.ego.y))
        told = json.loads(messages["/ego"][tick][2])
        assert told["speed"] == pytest.approx(snapshot.ego.speed)
        frame = messages["/tf"][tick][2]
        turn = 2 * math.atan2(frame.rotation.z, frame.rotation.w)
        assert math.remainder(turn - snapshot.ego.heading, math.tau) == pytest.approx(0.0, abs=1e-9)

        still = {e.id: e for e in messages["/scene"][0][2].entities}
        assert {s.id for s in scene.signs} | {o.id for o in scene.obstacles} <= set(still)
        assert {"road", "marking", "destination", "route", "plate_line"} <= set(still)
        (asphalt,) = (s.polygon for s in road_shapes(scene.network) if s.colour == "asphalt")
        triangles = [(p.x, p.y) for list_ in still["road"].triangles for p in list_.points]
        corners = np.array(triangles).reshape(-1, 3, 2)
        assert shapely.area(shapely.polygons(corners)).sum() == pytest.approx(asphalt.area, rel=0.01)
        assert shapely.union_all(shapely.polygons(corners)).area == pytest.approx(asphalt.area, rel=0.01)
        sentences = [content.message for _, _, content in messages.get("/violations", [])]
        assert sentences == [v.sentence for v in sorted(trace.verdicts.violations, key=lambda v: v.start_s)]
    assert any(trace.verdicts.violations for trace, _ in traces)


def _decoded(reader: Any) -> Any:
    """Schema, topic, message and its content: decoded protobuf, or JSON bytes as they are."""
    from mcap_protobuf.decoder import DecoderFactory

    factory = DecoderFactory()
    for schema, channel, message in reader.iter_messages():
        decoder = factory.decoder_for(channel.message_encoding, schema)
        content = message.data if decoder is None else decoder(message.data)
        yield schema.name, channel.topic, message, content


def test_who_leaves_and_comes_back_has_two_tracks(traces: list[tuple[Trace, Scene]]) -> None:
    for trace, _ in traces:
        tracks = actor_tracks(trace)
        assert sum(len(t.rows) for t in tracks) == sum(len(s.actors) for s in trace.snapshots)
        for track in tracks:
            middle = len(track.rows) // 2
            actors = trace.snapshots[track.first + middle].actors
            row = actors.index.tolist().index(actors.table.rows[track.name])
            assert track.rows[middle, :3] == pytest.approx(actors.pose[row])


@pytest.mark.slow
def test_the_command(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export = in_process("export", capsys)
    path = Path(export(str(run), "idm/speed_limit", "--format", "mcap")[0].strip())
    assert path == run / "exports" / "idm" / "speed_limit.mcap"
    assert path.read_bytes()[:5] == b"\x89MCAP"
    assert "name one EPISODE" in refused(export, str(run), "--format", "mcap")


def test_a_missing_extra_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    monkeypatch.delitem(sys.modules, WRITERS["mcap"][0].partition(":")[0], raising=False)
    monkeypatch.delitem(sys.modules, "tsbench.bridges.mcap_recording", raising=False)
    with pytest.raises(InputError, match=r"foxglove, which is not installed: pip install 'tsbench\[mcap\]'"):
        export_kind("mcap")
