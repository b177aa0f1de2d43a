"""What commands and pages share: settings, IMU library, opened logs, examined flights, live session.

Each module is a door of its own.
"""
