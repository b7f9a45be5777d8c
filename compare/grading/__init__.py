"""Submissions graded: a folder of people's filters held against a reference."""
