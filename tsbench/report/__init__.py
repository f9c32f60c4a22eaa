"""Tables, figures, bird's-eye views and video."""
