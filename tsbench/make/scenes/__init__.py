"""Scenes from maps: recipes, traffic, variants, the split."""
