"""TOML files that people write: every way in which one cannot be read is one clear sentence."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from companion.model import SettingsError


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
