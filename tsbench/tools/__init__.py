"""Tools around runs: bench, doctor, check, rescore."""
