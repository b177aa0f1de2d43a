"""What can be chosen beside the picture, and of the picture. Every choice becomes an event for the view thread."""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import urlsplit

import viser

from companion.model import Flight
from companion.view.panels.controls import listen, write
from companion.view.panels.reckoning_controls import ReckoningControls
from companion.view.state import events
from companion.view.state.choice import Offer, ReplayChoice
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


TRAILS = {
    "Last 60 s": events.SetTrail(60.0),
    "Last 10 s": events.SetTrail(10.0),
    "Path so far": events.SetTrail(None),
    "Whole path": events.SetTrail(None, ahead=True),
}


class Adjustments:
    """Folders of controls. Built once; `load` fits them to a flight."""

    def __init__(self, gui: viser.GuiApi, flight: Flight, offer: Offer, post: events.Post) -> None:
        self._post = post
        self._reckoning = ReckoningControls(gui, flight, offer, post)
        self._picture = PictureControls(
            gui, TRAILS, post, expects=True, map_host=urlsplit(offer.map_url or "").hostname or ""
        )
        self.playing = gui.add_folder("Playing")  # filled by the timeline
        with gui.add_folder("Save", expand_by_default=False):
            self._save(gui.add_button("This picture (PNG)", icon=viser.Icon.CAMERA), "picture")
            self._save(gui.add_button("The 3D replay (HTML)", icon=viser.Icon.FILE_EXPORT), "page")
            report = gui.add_button(
                "The report (HTML)",
                icon=viser.Icon.FILE_EXPORT,
                visible=offer.report is not None,
                hint="Verdict, charts and tables of what is shown, to mail or print",
            )
            self._save(report, "report")

    @property
    def picture(self) -> viser.GuiFolderHandle:
        """The folder in which each browser finds its own camera."""
        return self._picture.folder

    def load(self, flight: Flight, choice: ReplayChoice, start: float) -> None:
        """Fit the controls to what is shown now. Values set here come back as no events."""
        self._reckoning.load(flight, choice, start)

    def choose_map(self, shown: bool) -> None:
        """Say whether the map is shown."""
        self._picture.choose_map(shown)

    def offer(self, name: ExtraPath, there: bool) -> None:
        """Offer one of the extra paths, where there is one."""
        self._picture.offer(name, there)

    def _save(self, button: viser.GuiButtonHandle, what: events.Kept) -> None:
        @button.on_click
        async def _(click: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if click.client_id is not None:
                self._post(events.Save(click.client_id, what))
