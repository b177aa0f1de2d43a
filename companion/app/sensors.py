"""The IMU library `config/imu/*.toml`: noise specifications in SI, and the part that a vehicle says it carries."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from companion.app.files import read_toml
from companion.comparison import ImuNoise, ImuSpec, ModelFigure, SensorSpec, noise_model
from companion.installation import data_folder
from companion.model import STANDARD_GRAVITY, Flight, InputError, SettingsError
from companion.telemetry import id_parameters
from companion.verdict import Preflight, preflight

_DEGREE = math.radians(1.0)
_SI: Mapping[str, float] = {
    "mdps/√Hz": 1e-3 * _DEGREE,
    "dps/√Hz": _DEGREE,
    "µg/√Hz": 1e-6 * STANDARD_GRAVITY,
    "rad/s/√s": 1.0,
    "m/s²/√s": 1.0,
    "dps": _DEGREE,
    "mg": 1e-3 * STANDARD_GRAVITY,
    "g": STANDARD_GRAVITY,
    "%": 1e-2,
}

REQUESTED = "requested"
"""Why a specification is used that the user has named, and not the vehicle."""

_CALIBRATED_SCALE = 0.1
"""Part of the scale tolerance that is left after an accelerometer's six-position calibration."""

_SIMULATED = {"ardupilot": 0x2A, "px4": 0x14}
"""The device type of the IMU of each one's simulator."""


class _Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    value: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    unit: str
    kind: Literal["datasheet", "secondary", "typical", "measured"]
    source: str

    @property
    def si(self) -> float:
        return self.value * _SI[self.unit]


class _Sensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    noise_density: _Figure
    bias_walk: _Figure
    residual_bias: _Figure
    offset: _Figure
    scale: _Figure
    full_scale: _Figure


class _DeviceTypes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bits 16-23 of an IMU's id in the parameters. The autopilots number the parts differently.

    INS_GYRn_ID and INS_ACCn_ID: ArduPilot, AP_InertialSensor_Backend.h, enum DevTypes. CAL_GYROn_ID: PX4 v1.16.1,
    src/drivers/drv_sensor.h.
    """

    ardupilot: tuple[int, ...] = ()
    px4: tuple[int, ...] = ()


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    datasheet: str
    gyro: _Sensor
    accel: _Sensor
    device_types: _DeviceTypes = _DeviceTypes()


def imu_parts() -> list[str]:
    """The names in the library."""
    return sorted(path.stem for path in (data_folder("config") / "imu").glob("*.toml"))


def load_imu_spec(part: str, reason: str = REQUESTED) -> ImuSpec:
    """The specification of a part of the library, or of a .toml file of the same form, in SI.

    Raises InputError for a part that the library does not have, SettingsError for a file that is not of that form.
    """
    file = _load(part)
    return ImuSpec(part, _sensor(file.gyro), _sensor(file.accel), reason)


def imu_model_text(noise: ImuNoise, origin: str) -> str:
    """The file of an IMU of its own, of the form of the library: noise as measured, the rest as its part has it.

    Raises InputError and SettingsError as `load_imu_spec`.
    """
    base = _load(noise.imu_spec.name)
    lines = [
        f"name = {_quoted(f'{noise.imu} of {origin}')}",
        f"datasheet = {_quoted(f'noise measured; the rest is that of {base.name}')}",
    ]
    measured = dict(zip(("gyro", "accel"), noise_model(noise), strict=True))
    for sensor, noise_of in measured.items():
        part: _Sensor = getattr(base, sensor)
        for name in _Sensor.__struct_fields__:
            figure: _Figure = getattr(part, name)
            given = {"noise_density": noise_of.white, "bias_walk": noise_of.walk}.get(name)
            lines += ["", f"[{sensor}.{name}]", *_figure_lines(figure, given)]
    return "\n".join(lines) + "\n"


def _figure_lines(figure: _Figure, given: ModelFigure | None) -> list[str]:
    if given is not None and given.measured:
        value = float(f"{given.value / _SI[figure.unit]:.4g}")
        figure = msgspec.structs.replace(figure, value=value, kind="measured", source=given.source)
    words = (f"{name} = {_quoted(getattr(figure, name))}" for name in ("unit", "kind", "source"))
    return [f"value = {figure.value}", *words]


def _quoted(text: str) -> str:
    """A TOML string: JSON's escapes are TOML's too."""
    return msgspec.json.encode(text.encode("utf-8", "replace").decode()).decode()  # a name need not be UTF-8


def _load(part: str) -> _Part:
    path = Path(part) if part.endswith(".toml") else data_folder("config") / "imu" / f"{part.lower()}.toml"
    try:
        file = msgspec.convert(read_toml(path)[0], _Part)
        _sensor(file.gyro), _sensor(file.accel)  # units that are none
    except OSError:
        raise InputError(
            f"no IMU model {part!r}. The library has: {', '.join(imu_parts())}; or name a .toml file of that form."
        ) from None
    except (msgspec.ValidationError, KeyError) as error:
        raise SettingsError(f"{path} does not describe an IMU: {error}. config/imu/README.md says how.") from None
    return file


@cache
def _part_of(autopilot: str, kind: int) -> str | None:
    """The part of the library that has this number with an autopilot."""
    return next((part for part in imu_parts() if kind in getattr(_load(part).device_types, autopilot)), None)


def ardupilot_id(part: str) -> int:
    """What INS_GYR_ID is on a board with this part; 0 for one that ArduPilot has no number for."""
    types = _load(part).device_types.ardupilot
    return types[0] << 16 if types else 0


def imu_spec_of(flight: Flight, imu: str) -> ImuSpec:
    """The specification of the part that the vehicle's parameters name for this IMU message, else of generic-mems."""
    for parameter, (autopilot, name) in zip(
        id_parameters("gyro", flight.imus[imu].instance), (("ardupilot", "ArduPilot"), ("px4", "PX4")), strict=True
    ):
        identity = int(flight.parameters.get(parameter, 0))
        kind = identity >> 16 & 0xFF
        if not identity:
            continue
        if kind == _SIMULATED[autopilot]:  # no part of the library: it need not be read
            return load_imu_spec("generic-mems", f"{parameter} is {name}'s simulated IMU")
        if part := _part_of(autopilot, kind):
            return load_imu_spec(part, f"{parameter} = {identity}")
        return load_imu_spec("generic-mems", f"{parameter} = {identity} names a part that the library lacks")
    return load_imu_spec("generic-mems", "the vehicle's parameters name no part")


def _sensor(sensor: _Sensor) -> SensorSpec:
    si = {name: getattr(sensor, name).si for name in sensor.__struct_fields__}
    return SensorSpec(**si | {"scale": _CALIBRATED_SCALE * si["scale"]}, scale_tolerance=si["scale"])


def preflight_of(flight: Flight) -> Preflight:
    """The checks before take-off, each IMU's by its own part. Raises DataError where the vehicle never stands."""
    return preflight(flight, partial(imu_spec_of, flight))
