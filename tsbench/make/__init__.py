"""What made the data: from an OSM extract to a certified scene. Nothing that runs imports it."""
