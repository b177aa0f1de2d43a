"""The installation: the files that came with companion, its libraries, and the command that adds an extra."""

from companion.installation.data import DEMO, data_folder, log_path
from companion.installation.libraries import EXTRAS, Library, install_command, libraries, missing
