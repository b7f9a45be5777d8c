"""Files on disk: npz files, trajectories, folders of results."""
