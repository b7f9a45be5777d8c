"""The optimisation problem of a recording: exact residuals, Jacobians and retractions."""
