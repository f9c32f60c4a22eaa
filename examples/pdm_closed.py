"""PDM-Closed by its authors, with the arguments of their own configuration (docs/adapters.md).

tsbench run --planner examples/pdm_closed.py:PdmClosed --split dev

Needs nuplan-devkit, and a checkout of autonomousvision/tuplan_garage on PYTHONPATH.
"""

from nuplan.planning.simulation.trajectory.trajectory_sampling import TrajectorySampling
from tuplan_garage.planning.simulation.planner.pdm_planner.pdm_closed_planner import PDMClosedPlanner
from tuplan_garage.planning.simulation.planner.pdm_planner.proposal.batch_idm_policy import BatchIDMPolicy

from tsbench.bridges.nuplan import NuPlanPlanner


def closed() -> PDMClosedPlanner:
    policies = BatchIDMPolicy(
        speed_limit_fraction=[0.2, 0.4, 0.6, 0.8, 1.0],
        fallback_target_velocity=15.0,
        min_gap_to_lead_agent=1.0,
        headway_time=1.5,
        accel_max=1.5,
        decel_max=3.0,
    )
    return PDMClosedPlanner(
        trajectory_sampling=TrajectorySampling(num_poses=80, interval_length=0.1),
        proposal_sampling=TrajectorySampling(num_poses=40, interval_length=0.1),
        idm_policies=policies,
        lateral_offsets=[-1.0, 1.0],
        map_radius=50,
    )


class PdmClosed(NuPlanPlanner):
    make = staticmethod(closed)
    every = 10  # ticks of 0.1 s: a plan each second
