"""Holds the IMU's reckoning against the autopilot's estimate. Pure: imports tracks and strapdown."""
