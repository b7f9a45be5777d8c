"""Estimators by name: ours, and people's own."""
