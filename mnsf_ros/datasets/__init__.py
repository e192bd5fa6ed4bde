"""Public lidar data sets as streams of labelled sweeps, and their way into recordings."""
