"""Units as the formats write them → SI."""

from __future__ import annotations

import numpy as np

from companion.model import STANDARD_GRAVITY

SI = {
    "": 1.0,
    "mG": STANDARD_GRAVITY * 1e-3,
    "mrad/s": 1e-3,
    "m/s/s": 1.0,
    "rad/s": 1.0,
    "rad": 1.0,
    "m": 1.0,
    "m/s": 1.0,
    "cm/s": 1e-2,
    "cm": 1e-2,
    "mm": 1e-3,
    "mm/s": 1e-3,
    "Pa": 1.0,
    "hPa": 100.0,
    "degC": 1.0,  # temperatures stay in °C, as every data sheet has them
    "cdegC": 1e-2,
    "deg": float(np.radians(1.0)),
    "deglatitude": float(np.radians(1.0)),
    "deglongitude": float(np.radians(1.0)),
    "cdeg": float(np.radians(1e-2)),
    "degE7": float(np.radians(1e-7)),
    "gauss": 1e-4,  # tesla
    "Gauss": 1e-4,
    "mgauss": 1e-7,
    "hundredths": 1e-2,
}
"""Unit of MAVLink's dialects, of DataFlash's UNIT records or of PX4's topics → factor."""
