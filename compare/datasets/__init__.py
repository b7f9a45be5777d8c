"""Robots' logs and published recordings, a file per format."""
