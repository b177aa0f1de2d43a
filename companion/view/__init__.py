"""The replay and the live link in the browser. The only package that imports viser."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from companion.view.state.live import LONGEST_REANCHOR_S, LinkState, LiveStatus, Seen, StreamState
from companion.view.state.moments import analysed
from companion.view.state.places import best_path
from companion.view.state.sending import extremes
from companion.view.state.trajectory import (
    AnalysisResult,
    DisplayTrajectory,
    FlightChecks,
    Offer,
    ReplayChoice,
    chosen_track,
    display_trajectory,
    first_horizon,
    with_result,
    worst_stretch,
)

if TYPE_CHECKING:
    from companion.view.export import replay_page
    from companion.view.ground_map import check_url
    from companion.view.page import LiveViewer, Viewer

_WITH_VISER = {"LiveViewer": "page", "Viewer": "page", "check_url": "ground_map", "replay_page": "export"}
"""Name → its module, loaded when the name is first used: viser is slow to import, and a report without playback, a
fleet's page and a notebook's charts need none."""


def __getattr__(name: str) -> Any:
    if name not in _WITH_VISER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_WITH_VISER[name]}"), name)
