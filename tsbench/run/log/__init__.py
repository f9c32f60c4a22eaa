"""The run folder: journal, manifest, records, tables."""
