"""The installation: the files that came with companion, its libraries, and the command that adds an extra."""

from companion.installation.package import (
    DEMO,
    EXTRAS,
    Library,
    data_folder,
    install_command,
    libraries,
    log_path,
    missing,
    own_version,
)
