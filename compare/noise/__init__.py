"""Estimation of the noise of a recording from its measurements."""
