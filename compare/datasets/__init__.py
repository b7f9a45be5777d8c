"""Published recordings, a file per format."""
