"""Corrections on disk: what `companion calibrate` writes and `companion analyze --correction` applies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from companion.app.files import read_toml
from companion.comparison import PARTS, Calibration, Correction
from companion.model import InputError, SettingsError

_FORMAT = 2
"""1, which files without `format` have, turned the mounting the other way."""


_LIMITS = {
    "gyro_bias": (10.0, "rad/s"), "accel_bias": (100.0, "m/s²"), "mounting": (1.0, "rad"), "time_offset": (1.0, "s"),
    "gyro_scale": (0.5, "1"), "accel_scale": (0.5, "1"), "gyro_misalignment": (1.0, "rad; xy, xz, yx, yz, zx, zy"),
    "accel_misalignment": (1.0, "rad; yx, zx, zy"), "lever_arm": (100.0, "m"),
}  # fmt: skip
"""Part → the largest value that a file may have, and the unit as it stands there."""
_REQUIRED = ("gyro_bias", "accel_bias", "mounting", "time_offset")


def _key(part: str) -> tuple[str, Any, Any]:
    """Name, type and default of the key of a part."""
    count = PARTS[part].stop - PARTS[part].start
    most, _ = _LIMITS[part]
    number = Annotated[float, msgspec.Meta(ge=-most, le=most)]  # infinity and NaN are out of every bound
    kind = number if part == "time_offset" else tuple[(number,) * count]  # type: ignore[misc]
    return part, kind, msgspec.NODEFAULT if part in _REQUIRED else (0.0,) * count


_File: Any = msgspec.defstruct(
    "_File",
    [*map(_key, _LIMITS), ("format", Annotated[int, msgspec.Meta(ge=1, le=_FORMAT)], 1)],
    frozen=True,
    forbid_unknown_fields=True,
)


_NOT_OBSERVABLE = "not observable in this flight"


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
    origin = "".join(c if c.isprintable() else " " for c in origin)  # a name may have a line's end
    lines = [f"# IMU correction from {origin}, {calibration.windows} windows of {calibration.horizon_s:g} s."]
    lines += [
        "# true = (1 + [mounting]x)(1 + scale and misalignment)(measured - bias), at t - time_offset; body FRD.",
        "# The lever arm is from the point whose position the autopilot reports to the IMU.",
        "# What is not observable is 0, and the rest is what it is then: not quite as `companion calibrate` prints it.",
        f"format = {_FORMAT}",
    ]
    for part, place in PARTS.items():
        error = ", ".join(_known(calibration, i) for i in range(place.start, place.stop))
        if error == ", ".join([_NOT_OBSERVABLE] * (place.stop - place.start)):
            error = _NOT_OBSERVABLE
        numbers = ", ".join(f"{v:.8f}" for v in values[place])
        written = numbers if part == "time_offset" else f"[{numbers}]"
        lines.append(f"{part} = {written}  # {_LIMITS[part][1]}: {error}")
    return "\n".join(lines) + "\n"


def _known(calibration: Calibration, figure: int) -> str:
    """How well a figure is known, in words."""
    if calibration.observable[figure]:
        return f"± {calibration.sigma[figure]:.2g}"
    if calibration.assumed[figure]:
        return f"± {calibration.assumed_sigma[figure]:.2g} if what is not observable is 0"
    return _NOT_OBSERVABLE
