"""Taking the view along: the picture in a browser as PNG, the whole replay as an HTML page that needs no server."""

from __future__ import annotations

import io
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future

import numpy as np
import numpy.typing as npt
import viser
from PIL import Image
from viser.infra._infra import _remap_binary_placeholder_indices

from companion.model import CompanionError, Flight
from companion.present import palette
from companion.view.scene.cameras import camera, frame_of, readable_span
from companion.view.scene.drone import Move
from companion.view.scene.scene import Scene, unseen
from companion.view.scene.vehicle_shapes import drone_for
from companion.view.server.origin_check import script_of
from companion.view.server.web_server import Address, close_server, new_token, open_server
from companion.view.state.places import home_position
from companion.view.state.trajectory import DisplayTrajectory
from companion.view.state.work import begin, leave

FRAMES_HZ = 10.0
MOST_FRAMES = 3000  # five minutes; a longer flight gets fewer a second, so that the page stays small
ANNOTATED = 5  # frames, of which one has its words written: they are read, and poses are seen
RENDER_TIMEOUT_S = 30.0

Pixels = npt.NDArray[np.uint8]


def picture(client: viser.ClientHandle, *, dark: bool) -> bytes:
    """What the browser's canvas shows, as PNG. Blocks until the browser has drawn it: not for the view thread.

    Raises RuntimeError when the browser has gone or sends no picture, TimeoutError when it does not answer.
    """
    view = client.camera
    height, width = view.image_height, view.image_width
    try:
        drawn = client.get_render(height, width, transport_format="png", timeout=RENDER_TIMEOUT_S)
    except (RuntimeError, TimeoutError):
        raise
    except Exception as error:
        raise RuntimeError(f"the browser has sent no picture ({error})") from error
    pixels = np.asarray(drawn)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 4:
        raise RuntimeError(f"the browser has sent a picture of another kind ({pixels.dtype}, {pixels.shape})")
    file = io.BytesIO()
    Image.fromarray(over(pixels, 26 if dark else 255)).save(file, "PNG")
    return file.getvalue()


def over(rgba: Pixels, grey: int) -> Pixels:
    """Pixels (H, W, 4) laid over an even background, (H, W, 3)."""
    opacity = rgba[..., 3:].astype(np.uint16)
    return np.asarray((rgba[..., :3] * opacity + grey * (255 - opacity) + 127) // 255, np.uint8)


def replay_page(display: DisplayTrajectory, flight: Flight, *, dark: bool = False) -> str:
    """The 3D replay as one HTML file with its own player. Takes a second or two: not for the view thread."""
    drone = drone_for(flight.vehicle.type)
    framing = frame_of(display)
    view = camera("Free", framing)
    # The scene is drawn a second time, on a server of its own, so that nobody's picture moves meanwhile. Nobody knows
    # its token: no browser is meant to find it.
    server = open_server(Address("127.0.0.1", 0, loopback=True, token=new_token()))
    try:
        with server.atomic():  # nobody watches this server: its thread need not be woken for each of the writes
            view.begin(server.initial_camera)
            scene = Scene(server.scene, drone)
            scene.load(display, framing, drone, palette.of_imus(flight.imus), home_position(flight))
            scene.trails(-np.inf, np.inf)
            scene.seen_from(view.position)
            span = readable_span(framing.distance, drone.span_m, 1.0)
            duration = display.end - display.start
            step = max(1.0 / FRAMES_HZ, duration / MOST_FRAMES)
            recording = Recording(server)
            for i, sample in enumerate(display.samples(np.arange(display.start, display.end + 0.5 * step, step))):
                recording.add(scene.moves(sample))
                if i % ANNOTATED == 0:
                    scene.annotate(sample, span, unseen(view))
                recording.wait(step)
        return recording.html(dark=dark)
    finally:
        close_server(server)


_POSES = {"wxyz": "SetOrientationMessage", "position": "SetPositionMessage"}


class Recording:
    """A scene from now on, as one HTML page with a player. Moves are given to it; other changes it sees by itself."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._recorded = recorded = server.get_scene_serializer()
        self._places: dict[bytes, int] = {}  # of the bytes of a buffer, in the recording
        buffers, recorded._binary_buffers = recorded._binary_buffers, []
        places = [self._place(buffer) for buffer in buffers]
        for _, message in recorded._messages:
            _remap_binary_placeholder_indices(message, places)

    def add(self, moves: Iterable[Move]) -> None:
        """Record moves of this instant, without a write to the server, to which nobody listens.

        Messages as viser 1.1 records them: its handles take twenty times as long to come to the same, and there are
        seven in each picture.
        """
        when, messages = self._recorded._time, self._recorded._messages
        for node, name, value in moves:
            # float32, of which the browser's numbers are made: the digits behind only make the file larger.
            rounded = value.astype(np.float32)
            message: dict[str, object]
            if name == "points":
                buffered = {"__binary_index": self._place(rounded.data), "dtype": rounded.dtype.str}
                message = {"type": "SceneNodeUpdateMessage", "updates": {name: buffered}}
            else:
                message = {"type": _POSES[name], name: rounded.tolist()}
            message["name"], message["owner"] = node.name, ""
            messages.append((when, message))

    def wait(self, seconds: float) -> None:
        """What follows is shown so much later."""
        self._recorded.insert_sleep(seconds)

    def html(self, *, dark: bool) -> str:
        """The page. To be called once."""
        return self._recorded.as_html(dark_mode=dark).replace("<head>", f"<head>{script_of('dark_names.js')}", 1)

    def _place(self, buffer: memoryview) -> int:
        """Where these bytes are, each kept once: what is there twice viser looks for in every message at the end."""
        buffers = self._recorded._binary_buffers
        place = self._places.setdefault(bytes(buffer), len(buffers))
        if place == len(buffers):
            buffers.append(buffer)
        return place


PICTURE, PAGE, REPORT = "companion.png", "companion-replay.html", "companion-report.html"


class Saver:
    """Makes one file at a time. complain: called with why something could not be saved."""

    def __init__(self, complain: Callable[[str], object]) -> None:
        self._complain, self._turn = complain, threading.Lock()
        self._running: list[Future[str]] = []

    def save(self, client: viser.ClientHandle, name: str, make: Callable[[], bytes]) -> None:
        """Send the browser what `make` makes, as a file of this name."""

        def work() -> str:
            try:
                with self._turn:
                    content = make()
                client.send_file_download(name, content, save_immediately=True)
            except (RuntimeError, TimeoutError, CompanionError) as error:  # the browser has gone, or did not answer
                return f"{name} could not be saved: {error}"
            return ""

        self._running.append(begin("save", work))

    def poll(self) -> None:
        """Report what has gone wrong. An error that is none of the browser's is raised here."""
        for done in [future for future in self._running if future.done()]:
            self._running.remove(done)
            if why := done.result():
                self._complain(why)

    def close(self) -> None:
        """What is being made has a moment to end."""
        leave(self._running)
