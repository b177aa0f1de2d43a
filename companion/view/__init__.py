"""The replay and the live link in the browser. The only package that imports viser."""

from companion.view import palette
from companion.view.app import Viewer
from companion.view.choice import Examine, Offer, Recompute, ReplayChoice, chosen_track, with_track
from companion.view.export import replay_page
from companion.view.feed import Feed, Judgement, LinkState, Seen, StreamState
from companion.view.insight import Insight
from companion.view.live import LiveViewer
from companion.view.livepanel import LONGEST_REANCHOR_S
from companion.view.marks import Mark
from companion.view.moment import Footage, Reckoning
from companion.view.places import best_path
from companion.view.thin import extremes
from companion.view.worst import Worst, worst_stretch

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
    "chosen_track",
    "extremes",
    "palette",
    "replay_page",
    "with_track",
    "worst_stretch",
]
