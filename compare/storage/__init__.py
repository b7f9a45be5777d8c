"""What is kept on disk: npz files, trajectories, folders of results."""
