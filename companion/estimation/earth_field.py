"""The Earth's magnetic field at a place and time, by the World Magnetic Model (pygeomag)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from companion.constants import healthy, num
from companion.model import Array, Epoch, Origin


@dataclass(frozen=True, slots=True, eq=False)
class EarthField:
    """The field by the model."""

    ned: Array  # (3,) tesla
    sigma: Array  # (3,) tesla, 1σ: anomalies of the place, and what a compass calibration leaves of its scale
    declination: float  # rad
    inclination: float  # rad


def field_at(origin: Origin | None, epoch: Epoch | None) -> EarthField | None:
    """The field at the flight's origin; None where the place is not known or the model has none.

    Within 5° of a magnetic pole the field has no useful horizontal part; it is given as the model has it.
    """
    if origin is None or not np.isfinite([origin.latitude, origin.longitude, origin.height]).all():
        return None
    year = 1970.0 + epoch.unix_s / num.YEAR_S if epoch is not None and np.isfinite(epoch.unix_s) else num.UNDATED_YEAR
    year = float(np.clip(year, num.WMM_FIRST, num.WMM_LAST - 0.1)) if year >= num.WMM_FIRST else num.UNDATED_YEAR
    latitude, longitude = float(np.degrees(origin.latitude)), float(np.degrees(origin.longitude))
    if abs(latitude) > 89.99:
        return None
    return _model(round(latitude, 4), round((longitude + 180.0) % 360.0 - 180.0, 4), round(origin.height, -1), year)


@lru_cache(maxsize=64)
def _model(latitude: float, longitude: float, height: float, year: float) -> EarthField:
    from pygeomag import GeoMag  # noqa: PLC0415  (reads its coefficients when it is imported)

    base = int(5 * (year // 5))
    geomag = GeoMag(base_year=None if base >= 2025 else base)
    result = geomag.calculate(
        glat=latitude, glon=longitude, alt=height * 1e-3, time=year, allow_date_outside_lifespan=True
    )
    ned = np.array([result.x, result.y, result.z]) * 1e-9
    sigma = np.full(3, healthy.FIELD_ANOMALY * float(np.linalg.norm(ned)))
    return EarthField(ned, sigma, float(np.radians(result.d)), float(np.radians(result.i)))
