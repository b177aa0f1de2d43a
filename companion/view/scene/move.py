"""What changes in the scene from one instant to the next: written to the browsers, or into a recording."""

from __future__ import annotations

from typing import Literal, NamedTuple

import viser

from companion.model import Array


class Move(NamedTuple):
    """A new value of a node's property."""

    node: viser.SceneNodeHandle
    name: Literal["wxyz", "position", "points"]
    value: Array  # (4,) quaternion, (3,) m from the node above, or (M, 2, 3) float32, m

    def show(self) -> None:
        """Write it to whoever looks."""
        setattr(self.node, self.name, self.value)
