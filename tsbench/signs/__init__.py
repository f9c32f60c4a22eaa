"""The sign catalogue, its SUMO annotations and its plates."""
