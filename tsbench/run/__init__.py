"""Episodes, workers, records and resuming."""
