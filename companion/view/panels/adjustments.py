"""What can be chosen beside the picture. Every choice becomes an event for the view thread."""

from __future__ import annotations

from urllib.parse import urlsplit

import viser

from companion.model import Flight
from companion.view.panels.picture_controls import PictureControls
from companion.view.panels.reckoning_controls import ReckoningControls
from companion.view.state import events
from companion.view.state.choice import Offer, ReplayChoice
from companion.view.state.events import ExtraPath

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
