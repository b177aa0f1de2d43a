"""Parameters as a log has them: what is no number, or none of its type, is not known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from companion.model import Array

# MAV_PARAM_TYPE: UINT8, INT8, UINT16, INT16, UINT32, INT32 (common.xml). A float rounds the largest up to a power of 2.
_RANGES = {
    1: (0.0, 2.0**8 - 1), 2: (-(2.0**7), 2.0**7 - 1), 3: (0.0, 2.0**16 - 1), 4: (-(2.0**15), 2.0**15 - 1),
    5: (0.0, 2.0**32), 6: (-(2.0**31), 2.0**31),
}  # fmt: skip


def out_of_range(values: Array, types: Array) -> Array:
    """Which values (N,) are none of their MAV_PARAM_TYPE (N,), NaN and infinity among them."""
    wrong = ~np.isfinite(values)
    for number, (low, high) in _RANGES.items():
        wrong |= (types == number) & ~((values >= low) & (values <= high))
    return np.asarray(wrong)


def declination(parameters: Mapping[str, float]) -> float:
    """The magnetic declination, rad; 0: none, as before ArduPilot has looked it up for the place."""
    return parameters.get("COMPASS_DEC", 0.0)


def known(parameters: Mapping[str, float]) -> dict[str, float]:
    """Those that are finite numbers."""
    return {name: value for name, value in parameters.items() if np.isfinite(value)}


def identity(parameters: Mapping[str, float], *names: str, otherwise: int = 1) -> int:
    """The first that there is of these as a MAVLink id, 0 to 255; `otherwise` where it is none."""
    value = next((parameters[name] for name in names if name in parameters), np.nan)
    return int(value) if 0 <= value <= 255 else otherwise
