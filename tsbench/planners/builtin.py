"""The planners that come with tsbench, as the entry points name them: a list imports no planner."""

from __future__ import annotations

from tsbench.planners.registry import PlannerEntry
from tsbench.planners.weights import learned

IDM = PlannerEntry(target="tsbench.planners.idm:Idm", kind="rules", sign_access=False)
IDM_E = PlannerEntry(target="tsbench.planners.experts.expert:IdmExpert", kind="expert", privileged=True)
IDM_S1 = PlannerEntry(target="tsbench.planners.styles:IdmS1", kind="rules", sign_access=False)
IDM_S1_E = PlannerEntry(target="tsbench.planners.experts.expert:IdmS1Expert", kind="expert", privileged=True)
IDM_S2 = PlannerEntry(target="tsbench.planners.styles:IdmS2", kind="rules", sign_access=False)
IDM_S2_E = PlannerEntry(target="tsbench.planners.experts.expert:IdmS2Expert", kind="expert", privileged=True)
IDM_S3 = PlannerEntry(target="tsbench.planners.styles:IdmS3", kind="rules", sign_access=False)
IDM_S3_E = PlannerEntry(target="tsbench.planners.experts.expert:IdmS3Expert", kind="expert", privileged=True)
IDM_S4 = PlannerEntry(target="tsbench.planners.styles:IdmS4", kind="rules", sign_access=False)
IDM_S4_E = PlannerEntry(target="tsbench.planners.experts.expert:IdmS4Expert", kind="expert", privileged=True)
PPO = learned("ppo", "tsbench.planners.ppo.planner:Ppo")
PPO_E = learned(
    "ppo", "tsbench.planners.ppo.planner:PpoExpert", kind="expert", privileged=True, sign_access=True
)
CARL = learned("carl", "tsbench.planners.carl.planner:Carl")
CARL_E = learned(
    "carl", "tsbench.planners.carl.planner:CarlExpert", kind="expert", privileged=True, sign_access=True
)
PLANT2 = learned("plant2", "tsbench.planners.plant2.planner:Plant2")
PLANT2_E = learned(
    "plant2", "tsbench.planners.plant2.planner:Plant2Expert", kind="expert", privileged=True, sign_access=True
)
PLANT2_FT = learned("plant2-ft", "tsbench.planners.plant2.planner_ft:Plant2Ft", sign_access=True)
