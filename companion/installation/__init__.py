"""How companion was installed: the files that came with it, and the command that adds what is missing."""

from companion.installation.data import DEMO, data_folder, log_path
from companion.installation.extras import missing

__all__ = ["DEMO", "data_folder", "log_path", "missing"]
