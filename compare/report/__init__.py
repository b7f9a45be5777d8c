"""Pages that explain themselves: one HTML file each, with everything in it."""
