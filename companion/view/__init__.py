"""The replay and the live link in the browser. The only package that imports viser."""

from companion.view.app import LiveViewer, Viewer
from companion.view.export import replay_page
from companion.view.ground_map import check_url
from companion.view.panels.live_panel import LONGEST_REANCHOR_S
from companion.view.state.choice import Examine, Offer, Recompute, ReplayChoice, chosen_track, with_track
from companion.view.state.decimation import extremes
from companion.view.state.feed import Feed, Judgement, LinkState, Seen, StreamState
from companion.view.state.insight import Insight
from companion.view.state.marks import Mark
from companion.view.state.places import best_path
from companion.view.state.sample import Footage, Reckoning
from companion.view.state.worst import Worst, worst_stretch

__all__ = [
    "LONGEST_REANCHOR_S",
    "Examine",
    "Feed",
    "Footage",
    "Insight",
    "Judgement",
    "LinkState",
    "LiveViewer",
    "Mark",
    "Offer",
    "Reckoning",
    "Recompute",
    "ReplayChoice",
    "Seen",
    "StreamState",
    "Viewer",
    "Worst",
    "best_path",
    "check_url",
    "chosen_track",
    "extremes",
    "replay_page",
    "with_track",
    "worst_stretch",
]
