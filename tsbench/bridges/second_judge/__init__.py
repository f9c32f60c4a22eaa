"""A second judge, by others: TU Munich's `commonroad-stl-monitor` over episodes exported as CommonRoad scenarios.

Its rules are published formulas (Maierhofer et al.: R_G3, speed limits, 2020; R_IN1, stop signs, 2022). It evaluates
them in signal temporal logic, from lanelets, plates and the ego's track. No line of tsbench's monitors takes part.

    python -m tsbench.bridges.second_judge RUN
"""
