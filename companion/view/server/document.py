"""The HTML page that viser serves, made ours: title, icon, and what viser cannot do by itself (page_head.js)."""

from __future__ import annotations

import functools
import gzip
import re
from importlib.resources import files
from urllib.parse import quote

from companion.present import palette

ALIVE = "/companion-alive"
"""Asked for by an open page, to know whether companion is still there."""
REMEMBERED = "/companion-remembered"
"""Asked for by a page that has just been opened, with the instant and the IMU that it showed last."""
_TITLE = re.compile(rb"<title>.*?</title>", re.DOTALL)
_ICON = re.compile(rb'<link\s+rel="icon".*?/>', re.DOTALL)


@functools.lru_cache(maxsize=4)
def dressed(body: bytes, encoding: str) -> bytes:
    """viser's page with our title, icon and script. encoding: "gzip" or "identity", of `body` and of what comes back.

    Raises RuntimeError for a page that has not what viser 1.1's has.
    """
    plain = gzip.decompress(body) if encoding == "gzip" else body
    script = (files("companion.view.server") / "page_head.js").read_bytes()
    icon = f'<link rel="icon" href="data:image/svg+xml,{quote(_icon())}" />'.encode()
    for pattern, ours in ((_TITLE, b"<title>companion</title>"), (_ICON, icon)):
        match = pattern.search(plain)
        if match is None:
            raise RuntimeError("viser's page has no title or icon where 1.1 has it")
        plain = plain[: match.start()] + ours + plain[match.end() :]
    plain = plain.replace(b"<head>", b"<head><script>" + script + b"</script>", 1)
    return gzip.compress(plain) if encoding == "gzip" else plain


def _icon() -> str:
    """Two paths that part, in the colours of IMU and autopilot."""
    lines = (("M4 28C12 24 14 10 28 5", palette.AUTOPILOT), ("M4 28C14 26 20 22 28 20", palette.IMU))
    drawn = "".join(
        f'<path d="{path}" fill="none" stroke="{palette.css(colour)}" stroke-width="5" stroke-linecap="round"/>'
        for path, colour in lines
    )
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">{drawn}</svg>'
