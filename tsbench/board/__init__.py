"""Rows of the leaderboard: submitted as one file, driven again by anyone, shown as a site."""
