"""How far two navigation states are apart."""

from __future__ import annotations

import numpy as np

from companion.model import Array
from companion.strapdown import quaternion


def attitude_error(q_ref: Array, q: Array) -> Array:
    """Rotation vector of q_ref ⊗ q⁻¹, (..., 3) NED, rad: x and y are the tilt error, z the heading error."""
    return quaternion.log(quaternion.multiply(q_ref, quaternion.conjugate(q)))


def length(vectors: Array) -> Array:
    """Euclidean length along the last axis: (..., 3) to (...)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))
