"""Where a command writes: nothing is replaced unasked, and a file is whole or not there."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from companion.errors import InputError


def check(path: Path, *, force: bool) -> None:
    """Whether a file can be written there, before the work is done. Raises InputError when it cannot."""
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"cannot write {path}: {'it is a folder' if path.is_dir() else 'there is no such folder'}.")
    if path.exists() and not force:
        raise InputError(f"{path} exists. Choose another name, or replace it with --force.")


def check_folder(path: Path, names: list[str], *, force: bool) -> None:
    """Whether files of these names can be written into a folder, which need not be there yet."""
    if (path.exists() and not path.is_dir()) or not path.parent.is_dir():
        raise InputError(f"cannot write into {path}: {'it is a file' if path.exists() else 'there is no such folder'}.")
    if path.is_dir():
        for name in names:
            check(path / name, force=force)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name to write to that becomes `path` when all is well, and nothing when it is not.

    Raises InputError when the place cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}. Choose another place.") from None
    finally:
        part.unlink(missing_ok=True)
