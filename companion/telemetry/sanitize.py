"""What a vehicle or a log wrote, as text that may be shown."""

from __future__ import annotations

import re

_COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # PX4 writes its log texts for a terminal
_CONTROLS = {
    **dict.fromkeys((*range(32), *range(127, 160)), "\N{REPLACEMENT CHARACTER}"),
    **dict.fromkeys(map(ord, "\t\n\r"), " "),
}


def words(raw: bytes | str) -> str:
    """The text up to the first NUL, without the characters that command a terminal or begin a line there.

    Anybody on the link can send them: they would make colours, clear the screen, or write lines that seem to be ours.
    """
    text = raw.split(b"\0")[0].decode("utf-8", "replace") if isinstance(raw, bytes) else raw
    return text if text.isprintable() else _COLOURS.sub("", text).translate(_CONTROLS)
