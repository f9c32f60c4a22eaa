"""The four families: each module finds its maps in a source and names the pieces of a crop."""
