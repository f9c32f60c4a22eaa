"""The leaderboard: planners isolated, rows submitted as one file, driven again by anyone, shown as a site."""
