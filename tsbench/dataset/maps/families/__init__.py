"""The four families: each module finds its maps in a source and says of which pieces a crop is made."""
