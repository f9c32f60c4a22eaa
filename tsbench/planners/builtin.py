"""The planners that come with tsbench, as the entry points name them: a list imports no planner."""

from __future__ import annotations

from tsbench.planners.registry import PlannerEntry
from tsbench.planners.weights import learned

# Kinds that tables show: whose work it is.
THIRD_PARTY, REIMPLEMENTED = "third-party", "reimplemented"

IDM = PlannerEntry("tsbench.planners.idm:Idm", kind="rules", sign_access=False)
IDM_S1, IDM_S2, IDM_S3, IDM_S4 = (
    PlannerEntry(f"tsbench.planners.idm:IdmS{style}", kind="rules", sign_access=False) for style in (1, 2, 3, 4)
)
PPO = learned("ppo", "tsbench.learn.rl.ppo_planner:Ppo")
CARL = learned("carl", "tsbench.learn.rl.carl_planner:Carl")
PLANT2 = learned("plant2", "tsbench.learn.plant2.plant2_planner:Plant2")
PLANT2_FT = learned("plant2-ft", "tsbench.learn.plant2.plant2_planner:Plant2Ft", sign_access=True, chooses_route=True)
BLIND, COIN = (
    PlannerEntry(f"tsbench.planners.floor.guess:{name}", "floor", sign_access=False, chooses_route=True, floor=True)
    for name in ("Blind", "Coin")
)
CODES = PlannerEntry("tsbench.planners.floor.guess:Codes", "floor", chooses_route=True, floor=True)
PLANT2_BLIND = learned(
    "plant2-blind", "tsbench.learn.plant2.plant2_planner:Plant2Blind", chooses_route=True, floor=True
)
PLANT2_FT_SEED1 = learned(
    "plant2-ft-seed1", "tsbench.learn.plant2.ablations:SecondSeed", sign_access=True, chooses_route=True
)
# Planners that others made. An expert would put tsbench's own hand over what is measured, so none is made of them.
METADRIVE_PPO = PlannerEntry(
    "tsbench.bridges.metadrive:MetaDrivePpo", THIRD_PARTY, sign_access=False, chooses_route=True
)
COMMONROAD_REACTIVE = PlannerEntry(
    "tsbench.bridges.commonroad:Reactive", THIRD_PARTY, sign_access=True, chooses_route=True
)
PDM = PlannerEntry("tsbench.bridges.pdm:Pdm", REIMPLEMENTED, sign_access=False, chooses_route=True)
READER, CAREFUL = (
    PlannerEntry(f"tsbench.planners.reader:{name}", "expert", privileged=True) for name in ("Reader", "Careful")
)
CAUTIOUS, ELDERLY, ASSERTIVE = (
    PlannerEntry(f"tsbench.planners.reader:{name}", "expert", privileged=True)
    for name in ("Cautious", "Elderly", "Assertive")
)


def origin(spec: str) -> str:
    """Whose work the planner behind `--planner` is where it is not tsbench's nor the user's; else ""."""
    named = {"metadrive-ppo": METADRIVE_PPO, "commonroad-reactive": COMMONROAD_REACTIVE, "pdm": PDM}
    return named[spec].kind if spec in named else ""
