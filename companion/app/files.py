"""Files that a command writes, and TOML that people write.

Nothing is replaced unasked, and a file is whole or not there. Every way in which TOML cannot be read is one sentence.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from companion.model import InputError, SettingsError


def check(path: Path, *, force: bool) -> None:
    """Whether a file can be written there, before the work is done. Raises InputError when it cannot."""
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"cannot write {path}: {'it is a folder' if path.is_dir() else 'there is no such folder'}.")
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise InputError(
            f"cannot write {path}: it is a link, a pipe or a device, and none of these is replaced, not with --force "
            "either. Name a file."
        )
    if path.exists() and not force:
        raise InputError(f"{path} exists. Choose another name, or replace it with --force.")


def check_folder(path: Path, *, force: bool) -> None:
    """Whether files can be written into a folder, which need not be there yet. Raises InputError when they cannot."""
    if path.is_symlink():
        raise InputError(f"cannot write into {path}: it is a link. Name the folder itself.")
    if (path.exists() and not path.is_dir()) or not path.parent.is_dir():
        raise InputError(f"cannot write into {path}: {'it is a file' if path.exists() else 'there is no such folder'}.")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise InputError(f"{path} is not empty. Choose another folder, or replace files in it with --force.")


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name to write to that becomes `path` when all is well, and nothing when it is not.

    Raises InputError when the place cannot be written, or is a link, a pipe or a device.
    """
    check(path, force=True)
    part: Path | None = None
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)  # no planted link
        part = Path(name)
        mask = os.umask(0)
        os.umask(mask)
        part.chmod(0o666 & ~mask)  # as any other new file
        os.close(handle)
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}. Choose another place.") from None
    finally:
        if part is not None:
            part.unlink(missing_ok=True)


def write(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8. Raises as `replacing`."""
    with replacing(path) as part:
        if isinstance(content, bytes):
            part.write_bytes(content)
        else:
            part.write_text(content, encoding="utf-8", errors="replace")


@contextlib.contextmanager
def filling(path: Path) -> Iterator[Path]:
    """A folder to write to whose files move into `path` when all is well; `path` is made if need be.

    Raises InputError when the place cannot be written.
    """
    try:
        path.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".part-", dir=path) as part:
            yield Path(part)
            for file in sorted(Path(part).iterdir()):
                check(path / file.name, force=True)
                file.replace(path / file.name)
    except OSError as error:
        raise InputError(f"cannot write into {path}: {error.strerror or error}. Choose another place.") from None


def read_toml(path: str | Path) -> tuple[dict[str, Any], str]:
    """What the file says, and its text.

    Raises OSError when it cannot be read, SettingsError when it is no TOML: the message names the file and the line.
    """
    raw = Path(path).read_bytes().removeprefix(b"\xef\xbb\xbf")
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise SettingsError(
            f"{path}, line {line}: the byte {raw[error.start]:02X} is not UTF-8, as in a file of Windows-1252 (µ, °). "
            "Save the file as UTF-8."
        ) from None
    try:
        return tomllib.loads(text.replace("\r\n", "\n")), text
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{path} is not valid TOML: {error}.") from None
    except RecursionError:
        line = max(range(text.count("\n") + 1), key=lambda i: text.split("\n")[i].count("[")) + 1
        raise SettingsError(f"{path}, line {line}: arrays or tables are nested too deep to be read.") from None
    except ValueError as error:  # an integer of more than 4,300 digits
        raise SettingsError(f"{path} has a number that is too long to be one: {error}.") from None
