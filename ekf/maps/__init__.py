"""The map: state, correction, landmarks and their association."""
