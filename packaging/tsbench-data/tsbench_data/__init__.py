"""The data of tsbench's test split; found by `tsbench.core.paths`. © OpenStreetMap contributors, ODbL 1.0."""
