"""The map under a flight, from a server of tiles on this machine."""

from __future__ import annotations

import io
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from companion.model import Flight, InputError, Origin, SettingsError
from companion.view.ground_map import MapLayer, cache_folder, check_url, credit, ground_map
from companion.view.scene.cameras import Framing, frame
from companion.view.state.places import MapPicture, local_frame
from tests.waiting import wait_for

ZERO = Origin(np.radians(47.4), np.radians(8.5), 488.0)


class Server(ThreadingHTTPServer):
    """Tiles whose colour says where they lie; what was asked is kept."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.requested: list[tuple[str, str]] = []
        self.answer: bytes | int | None = None  # in place of a tile: this, or this status

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/{{z}}/{{x}}/{{y}}.png"


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        self.server.requested.append((self.path, self.headers["User-Agent"]))
        answer = self.server.answer
        self.send_response(answer if isinstance(answer, int) else 200)
        self.end_headers()
        if isinstance(answer, bytes):
            self.wfile.write(answer)
        elif answer is None:
            _, x, y = (int(part) for part in self.path.removesuffix(".png").split("/")[1:])
            self.wfile.write(png((x % 256, y % 256, 7)))

    def log_message(self, *_: object) -> None:
        pass


def png(colour: tuple[int, int, int], size: int = 256) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (size, size), colour).save(file, "PNG")
    return file.getvalue()


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


Ground = tuple[Flight, Framing]


@pytest.fixture
def ground(flight: Flight) -> Ground:
    assert flight.position is not None
    return replace(flight, origin=ZERO), frame(flight.position.position)


def test_the_picture_covers_the_flight_and_lies_where_the_tiles_say(
    ground: Ground, server: Server, tmp_path: Path
) -> None:
    found = ground_map(*ground, server.url, folder=tmp_path)
    assert 1 <= len(server.requested) <= 16
    low, high = found.centre - found.size / 2, found.centre + found.size / 2
    assert (low < ground[1].low[:2]).all()
    assert (high > ground[1].high[:2]).all()
    height, width, _ = found.pixels.shape
    assert width / height == pytest.approx(found.size[1] / found.size[0], rel=0.007), (
        "Mercator keeps shapes, on a sphere"
    )
    x, y = found.pixels[..., 0].astype(int), found.pixels[..., 1].astype(int)
    assert (np.diff(x, axis=1) >= 0).all(), "east is right"
    assert (np.diff(y, axis=0) >= 0).all(), "north is up"


def test_it_says_who_asks_and_asks_once(ground: Ground, server: Server, tmp_path: Path) -> None:
    first = ground_map(*ground, server.url, folder=tmp_path)
    assert all(agent.startswith("mavlink-companion/") for _, agent in server.requested)
    requested = len(server.requested)
    again = ground_map(*ground, server.url, folder=tmp_path)
    assert len(server.requested) == requested, "it is kept on the disk"
    assert (first.pixels == again.pixels).all()
    for kept in tmp_path.iterdir():
        kept.write_bytes(b"spoiled")
    assert (ground_map(*ground, server.url, folder=tmp_path).pixels == first.pixels).all()


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (503, "refuses"),
        (b"<html>log in to the hotel's network</html>", "no picture"),
        (png((0, 0, 0), 300), "not 256 by 256"),
        (bytes(3_000_000), "more than a tile"),
    ],
    ids=["refused", "captive portal", "size", "endless"],
)
def test_no_map_is_one_sentence(
    answer: bytes | int, reason: str, ground: Ground, server: Server, tmp_path: Path
) -> None:
    server.answer = answer
    with pytest.raises(InputError, match=f"No map: .*{reason}"):
        ground_map(*ground, server.url, folder=tmp_path)
    assert not list(tmp_path.iterdir()), "and nothing is kept of it"


def test_offline_is_one_sentence(ground: Ground, tmp_path: Path) -> None:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        url = f"http://127.0.0.1:{nobody.getsockname()[1]}/{{z}}/{{x}}/{{y}}.png"
        with pytest.raises(InputError, match=r"cannot be reached .* online\?"):
            ground_map(*ground, url, folder=tmp_path)


def test_a_slow_server_is_not_waited_for(ground: Ground, server: Server, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="too slow"):
        ground_map(*ground, server.url, folder=tmp_path, timeout_s=0.0)
    assert not server.requested


def test_a_flight_of_unknown_place_asks_nobody(flight: Flight, server: Server, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not tell where"):
        ground_map(flight, frame(np.zeros((2, 3))), server.url, folder=tmp_path)
    assert not server.requested


def test_places_and_metres_are_inverse(ground: Ground) -> None:
    local = local_frame(ground[0])
    assert local is not None
    corners = np.stack([ground[1].low[:2], ground[1].high[:2]])
    np.testing.assert_allclose(local.ground(local.places(corners)), corners, atol=1e-6)
    flat = np.column_stack([corners, np.zeros(2)])
    there = local.places(corners)
    height = np.full(2, local.origin.height)
    np.testing.assert_allclose(local.ned(there[:, 0], there[:, 1], height) - [0, 0, local.zero[2]], flat, atol=1e-6)


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))


@pytest.mark.usefixtures("cached")
def test_nothing_is_asked_before_somebody_asks(ground: Ground, server: Server) -> None:
    reported, laid = list[bool](), list[MapPicture | None]()
    layer = MapLayer(server.url, laid.append, reported.append, pytest.fail)
    layer.poll()
    assert not server.requested
    layer.show(True, *ground)

    def come() -> MapPicture | None:
        layer.poll()
        return laid[-1]

    wait_for(come, "the map has come")
    assert reported == [True]
    layer.show(False, *ground)
    assert laid[-1] is None
    layer.close()


@pytest.mark.usefixtures("cached")
def test_a_refusal_is_said_and_the_map_is_off(ground: Ground, server: Server) -> None:
    server.answer = 404
    reported, why = list[bool](), list[str]()
    layer = MapLayer(server.url, lambda _: None, reported.append, why.append)
    layer.show(True, *ground)

    def heard() -> list[str]:
        layer.poll()
        return why

    wait_for(heard, "it says why")
    assert "refuses (404" in why[0]
    assert (reported, layer.shown) == ([True, False], False)
    layer.close()


def test_addresses_of_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    check_url("https://tile.openstreetmap.org/{z}/{x}/{y}.png")
    for wrong in ("file:///{z}/{x}/{y}", "https://tiles.example/{z}/{x}", "{z}/{x}/{y}", "http:///{z}{x}{y}"):
        with pytest.raises(SettingsError, match="--map-url"):
            check_url(wrong)
    assert "OpenStreetMap" in credit("https://tile.openstreetmap.org/{z}/{x}/{y}.png")
    assert credit("https://tiles.example/{z}/{x}/{y}") == "Map: tiles.example"
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_folder().parts[-3:] == ("Library", "Caches", "mavlink-companion")
