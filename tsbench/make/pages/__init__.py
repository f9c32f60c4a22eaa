"""Pages, tables and pictures that show the data: scenes, maps, signs."""
