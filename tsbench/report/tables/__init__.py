"""Tables and charts of runs."""
