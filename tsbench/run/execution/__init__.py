"""Who drives the episodes: worker processes here or on a cluster."""
