"""Step times against map size."""
