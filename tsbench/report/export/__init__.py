"""Episodes in the formats of other projects: CommonRoad scenarios (XML) and MCAP recordings.

`episodes.py` has the entry points, `tracks.py` what the formats share; each format has its own files.
"""
