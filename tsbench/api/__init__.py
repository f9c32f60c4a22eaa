"""What scripts and notebooks call: the command line's work as Python, its tables as pandas."""
