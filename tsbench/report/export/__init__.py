"""Episodes in the formats of other projects: CommonRoad scenarios (XML) and MCAP recordings."""
