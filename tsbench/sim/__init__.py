"""The simulation: SUMO, the ego vehicle, the world snapshot, navigation."""
