"""A window of poses that is linearised anew: its scans, the way to its minimum, and what leaves it."""
