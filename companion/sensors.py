"""The IMU library: figures of known parts, each with its source, from `config/imu/*.toml` (see its README.md)."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Literal

import msgspec

from companion.errors import InputError, SettingsError
from companion.settings import data_folder
from companion.strapdown import ImuModel, Sensor
from companion.tracks import STANDARD_GRAVITY

_DPS, _MG = math.radians(1.0), STANDARD_GRAVITY * 1e-3
_SI = {
    "dps": _DPS,
    "dps/√Hz": _DPS,
    "mdps/√Hz": 1e-3 * _DPS,
    "rad/s/√s": 1.0,
    "mg": _MG,
    "g": 1e3 * _MG,
    "µg/√Hz": 1e-3 * _MG,
    "m/s²/√s": 1.0,
    "%": 0.01,
}


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One figure of a part, as its source prints it."""

    value: float
    unit: Literal["dps", "dps/√Hz", "mdps/√Hz", "rad/s/√s", "mg", "g", "µg/√Hz", "m/s²/√s", "%"]
    kind: Literal["datasheet", "secondary", "typical"]
    source: str  # where it is printed; for a typical value the reason

    @property
    def si(self) -> float:
        """The figure in rad, m and s."""
        return self.value * _SI[self.unit]


class SensorFigures(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The figures of a gyro (rad/s) or an accelerometer (m/s²)."""

    noise_density: Figure  # white noise, per √Hz
    bias_walk: Figure  # random walk of the bias, per √s
    residual_bias: Figure  # 1σ of the bias after the autopilot's calibration
    offset: Figure  # tolerance of the bias before any calibration
    scale: Figure  # tolerance of the scale before any calibration
    full_scale: Figure


class Imu(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of the library."""

    name: str
    datasheet: str
    gyro: SensorFigures
    accel: SensorFigures

    def model(self, *, gyro_step: float = 0.0, accel_step: float = 0.0) -> ImuModel:
        """The error model of a calibrated part: noise, walk and saturation, with the steps (SI) of its message.

        The residual bias is not in it: whoever simulates a part draws it, whoever predicts drift takes its variance.
        """

        def sensor(figures: SensorFigures, step: float) -> Sensor:
            return Sensor(
                noise_density=figures.noise_density.si,
                bias_walk=figures.bias_walk.si,
                step=step,
                full_scale=figures.full_scale.si,
            )

        return ImuModel(sensor(self.gyro, gyro_step), sensor(self.accel, accel_step))


def imu_names() -> tuple[str, ...]:
    """The parts of the library, by file name without its ending."""
    return tuple(sorted(path.stem for path in _folder().glob("*.toml")))


def load_imu(name: str | Path = "generic-mems") -> Imu:
    """A part of the library by its name, or one's own by the path of a TOML file.

    Raises InputError for a name or file that is not there, SettingsError for a file that does not describe an IMU.
    """
    path = Path(name) if str(name).endswith(".toml") else _folder() / f"{name}.toml"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        known = ", ".join(imu_names())
        raise InputError(f"no IMU {name}: choose one of {known}, or give the path of a TOML file like those.") from None
    try:
        return msgspec.convert(tomllib.loads(text), Imu)
    except (tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise SettingsError(f"{path}: {error}. config/imu/README.md describes such a file.") from None


def _folder() -> Path:
    return data_folder("config") / "imu"
