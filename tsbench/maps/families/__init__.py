"""The four families of maps: each module finds its maps in a source network and says which pieces a crop is made of."""
