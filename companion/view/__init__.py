"""The replay in the browser. The only package that imports viser."""

from companion.view import palette
from companion.view.app import Viewer
from companion.view.choice import Recompute, ReplayChoice, without_bias
from companion.view.export import replay_page
from companion.view.marks import Mark
from companion.view.moment import Envelope, Reckoning
from companion.view.thin import extremes

__all__ = [
    "Envelope",
    "Mark",
    "Reckoning",
    "Recompute",
    "ReplayChoice",
    "Viewer",
    "extremes",
    "palette",
    "replay_page",
    "without_bias",
]
