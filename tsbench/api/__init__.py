"""tsbench from Python: run planners, read runs, look at scenarios. Its names are those of `tsbench` itself."""
