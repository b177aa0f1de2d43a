"""Strapdown mathematics: IMU tracks in, trajectories out. Imports tracks and NumPy alone."""
