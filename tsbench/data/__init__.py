"""Data that does not come with the code: what there is of it, where it lies, and how it is fetched."""
