"""Parts of the sliding-window filter: observations, minimum and prior of a window of poses."""
