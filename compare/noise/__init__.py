"""The noise that the measurements of a log support."""
