"""Corrections on disk: what `companion calibrate` writes and `companion analyze --correction` applies."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from companion.analysis import Calibration, Correction
from companion.errors import InputError, SettingsError


def _bounded(most: float) -> msgspec.Meta:
    """Infinity and NaN are out of every bound."""
    return msgspec.Meta(ge=-most, le=most)


Rate = Annotated[float, _bounded(10)]  # rad/s
Force = Annotated[float, _bounded(100)]  # m/s²
Angle = Annotated[float, _bounded(1)]  # rad, small
Lag = Annotated[float, _bounded(1)]  # s


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    gyro_bias: tuple[Rate, Rate, Rate]
    accel_bias: tuple[Force, Force, Force]
    mounting: tuple[Angle, Angle, Angle]
    time_offset: Lag


def load_correction(path: str | Path) -> Correction:
    """Read a correction. Raises InputError when the file cannot be read, SettingsError when it is none."""
    try:
        found = msgspec.convert(tomllib.loads(Path(path).read_text(encoding="utf-8")), _File)
    except OSError as error:
        raise InputError(
            f"cannot read the correction {path}: {error.strerror}. Make one: companion calibrate LOG"
        ) from None
    except (tomllib.TOMLDecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path} is no correction: {error}. Make one: companion calibrate LOG -o {path}") from None
    return Correction(
        np.array(found.gyro_bias), np.array(found.accel_bias), np.array(found.mounting), found.time_offset
    )


def correction_text(calibration: Calibration, origin: str) -> str:
    """The file of a calibration: what the flight tells, zero for what it does not, each with its standard error."""
    values = np.where(calibration.observable, calibration.values, 0.0)
    lines = [f"# IMU correction from {origin}, {calibration.windows} windows of {calibration.horizon_s:g} s."]
    lines += ["# true = (1 + [mounting]x) (measured - bias), at t - time_offset; body FRD."]
    for name, unit, part in (
        ("gyro_bias", "rad/s", slice(0, 3)),
        ("accel_bias", "m/s²", slice(3, 6)),
        ("mounting", "rad", slice(6, 9)),
    ):
        error = ", ".join(
            f"{sigma:.2g}" if seen else "not observable in this flight"
            for sigma, seen in zip(calibration.sigma[part], calibration.observable[part], strict=True)
        )
        lines.append(f"{name} = [{', '.join(f'{v:.8f}' for v in values[part])}]  # {unit}, ± {error}")
    seen = f"± {calibration.sigma[9]:.2g}" if calibration.observable[9] else "not observable in this flight"
    lines.append(f"time_offset = {values[9]:.6f}  # s, {seen}")
    return "\n".join(lines) + "\n"
