"""The optimum."""
