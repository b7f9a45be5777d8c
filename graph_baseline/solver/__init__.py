"""Solvers of the optimisation problem of a recording: batch, and growing step by step."""
