"""Scores of estimates against truth and optimum, and their statistics."""
