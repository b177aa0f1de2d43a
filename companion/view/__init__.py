"""The replay in the browser. The only package that imports viser."""

from companion.view.app import Viewer
from companion.view.choice import Recompute, ReplayChoice, without_bias
from companion.view.marks import Mark
from companion.view.moment import Envelope, Reckoning

__all__ = ["Envelope", "Mark", "Reckoning", "Recompute", "ReplayChoice", "Viewer", "without_bias"]
