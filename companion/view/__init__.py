"""The replay in the browser. The only package that imports viser."""

from companion.view.app import Viewer
from companion.view.choice import Recompute, ReplayChoice

__all__ = ["Recompute", "ReplayChoice", "Viewer"]
