"""Corrections on disk: what `companion calibrate` writes and `companion analyze --correction` applies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from companion.analysis import PARTS, Calibration, Correction
from companion.app.toml_file import read_toml
from companion.model import InputError, SettingsError

_FORMAT = 2
"""1, which files without `format` have, turned the mounting the other way."""


def _bounded(most: float) -> msgspec.Meta:
    """Infinity and NaN are out of every bound."""
    return msgspec.Meta(ge=-most, le=most)


Rate = Annotated[float, _bounded(10)]  # rad/s
Force = Annotated[float, _bounded(100)]  # m/s²
Angle = Annotated[float, _bounded(1)]  # rad, small
Lag = Annotated[float, _bounded(1)]  # s
Part = Annotated[float, _bounded(0.5)]  # of the reading
Length = Annotated[float, _bounded(100)]  # m


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    gyro_bias: tuple[Rate, Rate, Rate]
    accel_bias: tuple[Force, Force, Force]
    mounting: tuple[Angle, Angle, Angle]
    time_offset: Lag
    gyro_scale: tuple[Part, Part, Part] = (0.0, 0.0, 0.0)
    accel_scale: tuple[Part, Part, Part] = (0.0, 0.0, 0.0)
    gyro_misalignment: tuple[Angle, Angle, Angle, Angle, Angle, Angle] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    accel_misalignment: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)
    lever_arm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    format: Annotated[int, msgspec.Meta(ge=1, le=_FORMAT)] = 1


_UNITS = {
    "gyro_bias": "rad/s",
    "accel_bias": "m/s²",
    "mounting": "rad",
    "time_offset": "s",
    "gyro_scale": "1",
    "accel_scale": "1",
    "gyro_misalignment": "rad; xy, xz, yx, yz, zx, zy",
    "accel_misalignment": "rad; yx, zx, zy",
    "lever_arm": "m",
}


_UNTOLD = "not observable in this flight"


def load_correction(path: str | Path) -> Correction:
    """Read a correction. Raises InputError when the file cannot be read, SettingsError when it is none."""
    try:
        file = msgspec.convert(read_toml(path)[0], _File)
    except OSError as error:
        raise InputError(
            f"cannot read the correction {path}: {error.strerror}. Make one: companion calibrate LOG"
        ) from None
    except msgspec.ValidationError as error:
        raise SettingsError(f"{path} is no correction: {error}. Make one: companion calibrate LOG -o {path}") from None
    vectors = {part: np.array(getattr(file, part)) for part in PARTS if part != "time_offset"}
    if file.format == 1:
        vectors["mounting"] = -vectors["mounting"]
    return Correction(**vectors, time_offset=file.time_offset)


def correction_text(calibration: Calibration, origin: str) -> str:
    """The file of a calibration: what the flight tells, zero for what it does not, each with its standard error."""
    values = calibration.correction.values
    lines = [f"# IMU correction from {origin}, {calibration.windows} windows of {calibration.horizon_s:g} s."]
    lines += [
        "# true = (1 + [mounting]x)(1 + scale and misalignment)(measured - bias), at t - time_offset; body FRD.",
        "# The lever arm is from the point whose position the autopilot reports to the IMU.",
        f"format = {_FORMAT}",
    ]
    for part, place in PARTS.items():
        error = ", ".join(_known(calibration, i) for i in range(place.start, place.stop))
        if error == ", ".join([_UNTOLD] * (place.stop - place.start)):
            error = _UNTOLD
        numbers = ", ".join(f"{v:.8f}" for v in values[place])
        written = numbers if part == "time_offset" else f"[{numbers}]"
        lines.append(f"{part} = {written}  # {_UNITS[part]}: {error}")
    return "\n".join(lines) + "\n"


def _known(calibration: Calibration, figure: int) -> str:
    """How well a figure is known, in words."""
    if calibration.observable[figure]:
        return f"± {calibration.sigma[figure]:.2g}"
    if calibration.assumed[figure]:
        return f"± {calibration.assumed_sigma[figure]:.2g} if what is not observable is 0"
    return _UNTOLD
