"""Worker processes that drive the episodes, here or on a cluster."""
