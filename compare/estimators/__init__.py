"""Estimators by name: built-in ones, graphs with the associations of a filter, and user code."""
