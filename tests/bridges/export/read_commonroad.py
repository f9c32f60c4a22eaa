"""Run by test_exports in a process of its own: opens files with CommonRoad's own reader, prints JSON."""

from __future__ import annotations

import json
import sys

from commonroad.common.file_reader import CommonRoadFileReader
from commonroad.scenario.traffic_sign import TrafficSignIDZamunda


def seen(path: str) -> dict[str, object]:
    scenario, problems = CommonRoadFileReader(path).open()
    (problem,) = problems.planning_problem_dict.values()
    roads = scenario.lanelet_network
    ego = scenario.dynamic_obstacles[0]
    last = ego.state_at_time(ego.prediction.final_time_step)
    at = roads.find_lanelet_by_position([problem.initial_state.position])[0]
    return {
        "id": str(scenario.scenario_id),
        "dt": scenario.dt,
        "lanelets": len(roads.lanelets),
        "dangling": [
            other
            for lanelet in roads.lanelets
            for other in lanelet.successor + lanelet.predecessor
            if roads.find_lanelet_by_id(other) is None
        ],
        "opposite": [
            [lanelet.lanelet_id, lanelet.adj_left]
            for lanelet in roads.lanelets
            if lanelet.adj_left is not None and not lanelet.adj_left_same_direction
        ],
        "stops": [
            [
                lanelet.lanelet_id,
                lanelet.stop_line.line_marking.value,
                [
                    roads.find_traffic_sign_by_id(ref).traffic_sign_elements[0].traffic_sign_element_id.name
                    for ref in lanelet.stop_line.traffic_sign_ref or ()
                ],
            ]
            for lanelet in roads.lanelets
            if lanelet.stop_line is not None
        ],
        "intersections": [
            [
                [
                    sorted(arm.incoming_lanelets),
                    sorted(arm.successors_right),
                    sorted(arm.successors_straight),
                    sorted(arm.successors_left),
                ]
                for arm in crossing.incomings
            ]
            for crossing in roads.intersections
        ],
        "types": sorted({kind.value for lanelet in roads.lanelets for kind in lanelet.lanelet_type}),
        "signs": [
            [e.traffic_sign_element_id.name, e.additional_values, sign.position.tolist()]
            for sign in roads.traffic_signs
            for e in sign.traffic_sign_elements
        ],
        "obstacles": [
            [o.obstacle_type.value, o.initial_state.time_step, o.obstacle_shape.length, o.obstacle_shape.width]
            for o in scenario.dynamic_obstacles
        ],
        "static": [o.obstacle_type.value for o in scenario.static_obstacles],
        "start": at,
        "ego": [*last.position.tolist(), last.orientation, last.velocity, last.time_step],
        "reached": bool(problem.goal.is_reached(last)),
    }


if __name__ == "__main__":
    numbers = {number: TrafficSignIDZamunda(number).name for number in sys.argv[1].split(",")}
    print(json.dumps({"numbers": numbers, "files": [seen(path) for path in sys.argv[2:]]}))
