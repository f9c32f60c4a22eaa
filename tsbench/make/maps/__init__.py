"""From an OSM extract to a pool of small SUMO networks."""
