"""What the commands, the page and a notebook share: settings, IMU library, opened logs, examined flights, live session.

Each module is a door of its own: `settings` costs nothing to load, `examination` loads the whole analysis.
"""
