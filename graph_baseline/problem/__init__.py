"""The optimisation problem of a recording: exact residuals, Jacobians, and how a solution moves."""
