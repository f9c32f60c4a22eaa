"""The planners that come with tsbench, as the entry points name them: a list imports no planner."""

from __future__ import annotations

from tsbench.planners.registry import PlannerEntry

IDM = PlannerEntry(target="tsbench.planners.idm:Idm", kind="rules", sign_access=False)
IDM_E = PlannerEntry(target="tsbench.planners.expert:IdmExpert", kind="expert", privileged=True)
