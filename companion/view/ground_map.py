"""A map under the flight, on request: tiles of a server on the network, kept on the disk for a while.

Nothing is fetched before it is requested.
"""

from __future__ import annotations

import contextlib
import hashlib
import http.client
import io
import os
import struct
import sys
import tempfile
import time
import urllib.error
import urllib.request
import zlib
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import numpy.typing as npt
from PIL import Image

from companion.model import CompanionError, Flight, InputError, SettingsError
from companion.view.scene.cameras import Framing
from companion.view.state.places import MapPicture, local_frame, tiles_over
from companion.view.state.work import Worker

TIMEOUT_S = 20.0
"""For all tiles together."""
_TILE_S = 6.0
_MOST_BYTES = 2_000_000  # of a tile
_PIXELS = 256
_FRESH_S = 14 * 86400.0  # a tile is requested again then; OpenStreetMap's policy is a week at least
_MOST_KEPT = 500  # tiles
_LEAST_M = 80.0  # of ground on each side of a vehicle that stands still
_KINDS = ("PNG", "JPEG", "WEBP")
_BROKEN = (
    OSError, ValueError, SyntaxError, EOFError, struct.error, zlib.error,
    Image.DecompressionBombError, Image.DecompressionBombWarning,
)  # fmt: skip
"""What Pillow raises of a picture that is none."""

Pixels = npt.NDArray[np.uint8]


def check_url(url: str) -> None:
    """Raises SettingsError for what is no template of tiles' addresses."""
    parts = urlsplit(url)
    if parts.scheme not in ("http", "https") or not parts.hostname or not all(f"{{{key}}}" in url for key in "zxy"):
        raise SettingsError(
            f"--map-url: needs an http or https address with {{z}}, {{x}} and {{y}} in it, got {url!r}."
        )


class MapLayer:
    """The map of a replay: fetched in a thread of its own, of which only the newest order counts.

    lay: called with the picture, or None to take it away; report: with whether a map is shown or on its way; complain:
    with why there is none.
    """

    def __init__(
        self,
        url: str | None,
        lay: Callable[[MapPicture | None], object],
        report: Callable[[bool], object],
        complain: Callable[[str], object],
    ) -> None:
        self._url, self._lay, self._report, self._complain = url or "", lay, report, complain
        self._fetcher = Worker("map")
        self.poll, self.close = self._fetcher.poll, self._fetcher.close
        self.shown = False

    def show(self, shown: bool, flight: Flight, framing: Framing) -> None:
        """Fetch the map of this flight, or take it away."""
        self._lay(None)
        self._report(shown)
        self._fetcher.forget()
        self.shown = shown
        if shown:
            self._fetcher.request(partial(ground_map, flight, framing, self._url), self._take)

    def _take(self, answer: MapPicture | CompanionError) -> None:
        if isinstance(answer, MapPicture):
            self._lay(answer)
            return
        self.shown = False
        self._report(False)
        self._complain(str(answer))


def ground_map(
    flight: Flight, framing: Framing, url: str, *, folder: Path | None = None, timeout_s: float = TIMEOUT_S
) -> MapPicture:
    """The picture of the ground, with some around it.

    url: template of the tiles' addresses; folder: where tiles are kept, None for the user's cache. Raises InputError
    where the log does not tell where it flew, or the server does not give every tile within `timeout_s`.
    """
    around = max(_LEAST_M, 0.1 * float(np.max(framing.high[:2] - framing.low[:2])))
    local = local_frame(flight)
    if local is None:
        raise InputError("No map: this log does not tell where on Earth it was flown.")
    corners = np.stack([framing.low - around, framing.high + around])[:, :2]
    tiles = tiles_over(*local.places(corners).ravel().tolist())
    pixels = np.zeros((tiles.rows * _PIXELS, tiles.columns * _PIXELS, 3), dtype=np.uint8)
    end, folder = time.monotonic() + timeout_s, folder or cache_folder() / "map-tiles"
    for row, column, x, y in tiles:
        tile = _tile(url, folder, (tiles.zoom, x, y), end)
        pixels[row * _PIXELS : (row + 1) * _PIXELS, column * _PIXELS : (column + 1) * _PIXELS] = tile
    _tidy(folder)
    low, high = local.ground(np.array(tiles.corners).reshape(2, 2))
    return MapPicture(pixels, (low + high) / 2, high - low, credit(url))


def credit(url: str) -> str:
    """Who has to be named."""
    host = urlsplit(url).hostname or ""
    return "© OpenStreetMap contributors" if "openstreetmap" in host else f"Map: {host}"


def cache_folder() -> Path:
    """Of this program, in the place that the system has for such."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "mavlink-companion"


def _tile(url: str, folder: Path, place: tuple[int, int, int], end: float) -> Pixels:
    """(256, 256, 3), from the disk, or from the server where it is not there or old.

    place: zoom, x and y; end: of a monotonic clock, until when the server may take.
    """
    mark = hashlib.sha256(url.encode()).hexdigest()[:12]
    kept = folder / "-".join((mark, *map(str, place)))
    with contextlib.suppress(OSError, InputError):  # not there, or spoiled: it is requested
        if time.time() - kept.stat().st_mtime < _FRESH_S:
            return _decoded(kept.read_bytes())
    for key, number in zip("zxy", place, strict=True):
        url = url.replace(f"{{{key}}}", str(number))
    data = _fetched(url, end)
    pixels = _decoded(data)
    with contextlib.suppress(OSError):  # without a cache it is only fetched again
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as part:
            part.write(data)
        Path(part.name).replace(kept)
    return pixels


def _tidy(folder: Path) -> None:
    """Let the oldest tiles go, where there are too many."""
    with contextlib.suppress(OSError):
        kept = sorted(folder.iterdir(), key=lambda path: -path.stat().st_mtime)
        for path in kept[_MOST_KEPT:]:
            path.unlink(missing_ok=True)


def _fetched(url: str, end: float) -> bytes:
    host = urlsplit(url).hostname
    left = end - time.monotonic()
    if left <= 0:
        raise InputError(f"No map: {host} is too slow. Try again: what has come is kept.")
    request = urllib.request.Request(url, headers={"User-Agent": _user_agent()})
    try:
        with urllib.request.urlopen(request, timeout=min(_TILE_S, left)) as answer:
            data: bytes = answer.read(_MOST_BYTES + 1)
    except urllib.error.HTTPError as error:
        error.close()
        raise InputError(f"No map: {host} refuses ({error.code} {error.reason}).") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        raise InputError(f"No map: {host} cannot be reached ({reason}). Is this computer online?") from None
    if len(data) > _MOST_BYTES:
        raise InputError(f"No map: {host} sends more than a tile.")
    return data


def _decoded(data: bytes) -> Pixels:
    """The picture in a tile. Raises InputError for what is none of 256 by 256 pixels."""
    try:
        with Image.open(io.BytesIO(data), formats=_KINDS) as picture:
            if picture.size != (_PIXELS, _PIXELS):
                raise InputError(f"No map: the server's tiles are not {_PIXELS} by {_PIXELS} pixels.")
            return np.asarray(picture.convert("RGB"))
    except _BROKEN:
        raise InputError("No map: what the server sends is no picture.") from None


def _user_agent() -> str:
    try:
        own = version("mavlink-companion")
    except PackageNotFoundError:
        own = "unknown"
    return f"mavlink-companion/{own} (MAVLink telemetry companion)"
