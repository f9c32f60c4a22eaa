"""Scenario rows, recipes, variants and the split."""
