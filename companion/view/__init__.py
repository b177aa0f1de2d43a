"""The replay and the live link in the browser. The only package that imports viser."""

from companion.view import palette
from companion.view.app import Viewer
from companion.view.choice import Recompute, ReplayChoice, without_bias
from companion.view.export import replay_page
from companion.view.feed import Feed, Judgement, LinkState, Seen, StreamState
from companion.view.live import LiveViewer
from companion.view.marks import Mark
from companion.view.moment import Envelope, Reckoning
from companion.view.thin import extremes

__all__ = [
    "Envelope",
    "Feed",
    "Judgement",
    "LinkState",
    "LiveViewer",
    "Mark",
    "Reckoning",
    "Recompute",
    "ReplayChoice",
    "Seen",
    "StreamState",
    "Viewer",
    "extremes",
    "palette",
    "replay_page",
    "without_bias",
]
