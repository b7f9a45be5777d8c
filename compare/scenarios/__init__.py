"""Scenarios: what a simulated run consists of, read from TOML files, and its simulation."""
