"""The oracle: the experts' drives as a data set."""
