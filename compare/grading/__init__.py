"""Grades of user filters in comparison with a reference."""
