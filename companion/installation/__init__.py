"""The installation: the files that came with companion, and the command that adds an extra."""

from companion.installation.data import DEMO, data_folder, log_path
from companion.installation.install_command import missing

__all__ = ["DEMO", "data_folder", "log_path", "missing"]
