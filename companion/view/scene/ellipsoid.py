"""Where the autopilot should be, seen from the IMU: three standard deviations of the expected position error."""

from __future__ import annotations

import numpy as np
import viser

from companion.model import Array
from companion.present import Rgb
from companion.strapdown import quaternion
from companion.view.state.sending import update

SIGMAS = 3.0
MOST_M = 1e5
_CHANGE = 0.02  # part of a semi-axis (rad for the turn) that is too small to see


def semi_axes(covariance: Array) -> tuple[Array, Array]:
    """(3,) lengths of the semi-axes of one standard deviation, m, and (4,) wxyz that turns x, y, z into them, NED."""
    values, vectors = np.linalg.eigh(covariance)
    if np.linalg.det(vectors) < 0:
        vectors[:, 2] = -vectors[:, 2]
    return np.sqrt(np.maximum(values, 0.0)), quaternion.from_matrix(vectors)


class Ellipsoid:
    """A pale body around the IMU, on demand. Only the view thread may call it."""

    def __init__(self, scene: viser.SceneApi, name: str, colour: Rgb) -> None:
        self.shown = False
        self._scale, self._turn = np.zeros(3), np.zeros(4)
        self._handle = scene.add_icosphere(
            name, 1.0, colour, opacity=0.14, visible=False, cast_shadow=False, receive_shadow=False
        )

    @property
    def axes(self) -> Array:
        """(3,) semi-axes that are drawn, m; zero while it is hidden."""
        return self._scale if self._handle.visible else np.zeros(3)

    def load(self, colour: Rgb) -> None:
        """Take the colour of another IMU."""
        self._handle.color = colour

    def put(self, position: Array) -> None:
        """Move it, NED m."""
        if self._handle.visible:
            self._handle.position = position

    def shape(self, covariance: Array, position: Array) -> None:
        """Take the form of `covariance` (3, 3), m²: zero hides it."""
        if not self.shown:
            update(self._handle, visible=False)
            return
        axes, turn = semi_axes(covariance)
        axes = np.clip(SIGMAS * axes, 0.0, MOST_M)
        visible = bool(axes.max() > 0)
        if visible:
            near = np.abs(axes - self._scale) <= _CHANGE * self._scale
            if not near.all() or abs(float(turn @ self._turn)) < 1 - _CHANGE**2:
                self._scale, self._turn = axes, turn
                x, y, z = (max(float(a), 1e-6) for a in axes)
                self._handle.scale = (x, y, z)
                self._handle.wxyz = turn
        if self._handle.visible != visible:
            self._handle.visible = visible
            self._handle.position = position
