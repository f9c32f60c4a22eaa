"""What planners share: paths, speeds, gaps, steering."""
