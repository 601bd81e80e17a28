"""Reading and writing: point clouds, scans, trajectories and maps."""
