"""What can be chosen of the picture, whatever it shows."""

from __future__ import annotations

from collections.abc import Mapping

import viser

from companion.view.panels.controls import listen, write
from companion.view.state import events
from companion.view.state.events import SHOWN, ExtraPath
from companion.view.state.visible import show

EXTRA_PATHS: dict[ExtraPath, tuple[str, str]] = {
    "gps": ("GPS fixes", "Positions of the GPS receiver, unfiltered"),
    "best": ("Best estimate", "From IMU, GPS, compass, barometer and rest, without the autopilot's estimate"),
}
"""Name and hint."""
SIZES = {"Easy to see": 1.0, "Larger": 1.7, "Smaller": 0.5, "True size": None}


class PictureControls:
    """A folder of choices. `folder` is there for the cameras, of which each browser has its own."""

    def __init__(
        self,
        gui: viser.GuiApi,
        trails: Mapping[str, events.SetTrail],
        post: events.Post,
        *,
        expects: bool,
        map_host: str = "",
    ) -> None:
        """expects: whether it is known how far the autopilot should be, and the ellipsoid can be drawn.

        map_host: whose map can be laid under the flight; "" for none.
        """
        self._extra_paths: dict[ExtraPath, viser.GuiCheckboxHandle] = {}
        self.folder = gui.add_folder("Picture")
        with self.folder:
            trail = gui.add_dropdown("Paths", tuple(trails))
            for name, (label, hint) in EXTRA_PATHS.items():
                self._extra_paths[name] = gui.add_checkbox(label, SHOWN[name], hint=hint, visible=False)
            self._map = gui.add_checkbox(
                "Map of the ground",
                False,
                visible=bool(map_host),
                hint=f"Asks {map_host} for pictures of the ground there. Nothing is asked before",
            )
            size = gui.add_dropdown("Drones", tuple(SIZES))
            ball = gui.add_checkbox(
                "3σ ellipsoid",
                False,
                visible=expects,
                hint="Around the IMU: where the autopilot should be, if nothing is wrong",
            )
            arrows = gui.add_checkbox("Arrows", False, hint="Velocity of both, and gravity")
            dark = gui.add_checkbox("Dark", False)
        listen(trail, post, lambda: trails[trail.value])
        listen(size, post, lambda: events.SetSize(SIZES[size.value]))
        listen(ball, post, lambda: events.SetRange(ball.value))
        listen(arrows, post, lambda: events.SetArrows(arrows.value))
        listen(self._map, post, lambda: events.SetMap(self._map.value is True))
        listen(dark, post, lambda: events.SetDark(dark.value))
        for name, box in self._extra_paths.items():
            self._listen(name, box, post)

    def _listen(self, name: ExtraPath, box: viser.GuiCheckboxHandle, post: events.Post) -> None:
        listen(box, post, lambda: events.SetPath(name, box.value is True))

    def choose_map(self, shown: bool) -> None:
        """Say whether the map is shown."""
        if self._map.value != shown:
            write(self._map, shown)

    def offer(self, name: ExtraPath, there: bool) -> None:
        """Offer one of the extra paths, where there is one."""
        show(self._extra_paths[name], there)
