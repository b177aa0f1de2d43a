"""Typed settings: what a settings file may say. `config/default.toml` documents every key with its unit and default."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec

from companion.app.files import read_toml
from companion.comparison import HORIZONS_S, Integration, Limits, ReferenceSpec
from companion.model import InputError, SettingsError
from companion.strapdown import METHODS, MIDDLES

Positive = Annotated[float, msgspec.Meta(gt=0, le=1e6)]  # the upper bound keeps infinity out
NotNegative = Annotated[float, msgspec.Meta(ge=0, le=1e6)]
Small = Annotated[float, msgspec.Meta(ge=0, le=10)]
SmallPositive = Annotated[float, msgspec.Meta(gt=0, le=10)]

_HOW, _LIMITS, _AUTOPILOT = Integration(), Limits(), ReferenceSpec()
"""The defaults of the analysis, which are those of the settings."""

if TYPE_CHECKING:
    Method = str
    Middle = str
else:
    Method, Middle = Literal[tuple(METHODS)], Literal[tuple(MIDDLES)]  # whatever integrators there are


class _Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of the settings file. An unknown key is an error, not a silent nothing."""


class LogSettings(_Section, frozen=True):
    """How logs are read."""

    dialect: str = "ardupilotmega"
    dequantise: bool = False
    max_size_gb: Positive = 0.8

    @property
    def options(self) -> dict[str, Any]:
        """As `read_recording` takes them."""
        return msgspec.structs.asdict(self)


class IntegrationSettings(_Section, frozen=True):
    """How the IMU is integrated."""

    method: Method = _HOW.method
    middle: Middle = _HOW.middle
    segments: Annotated[int, msgspec.Meta(ge=1, le=64)] = _HOW.segments
    gravity: Literal["standard", "normal"] | Annotated[float, msgspec.Meta(ge=9.7, le=9.9)] = "standard"


class DriftSettings(_Section, frozen=True):
    """Which windows the drift is measured over."""

    horizons_s: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=1)] = HORIZONS_S
    gap_periods: Positive = _LIMITS.gap_periods
    gap_s: NotNegative = _LIMITS.gap_s
    position_jump_m: Positive = _LIMITS.position_jump_m
    attitude_jump_deg: Positive = _LIMITS.attitude_jump_deg


class AutopilotSettings(_Section, frozen=True):
    """How far the autopilot's own estimate may be off, 1σ."""

    tilt: Small = _AUTOPILOT.tilt
    heading: Small = _AUTOPILOT.heading
    attitude_noise: SmallPositive = _AUTOPILOT.attitude_noise
    velocity: SmallPositive = _AUTOPILOT.velocity
    position: SmallPositive = _AUTOPILOT.position
    time_offset: Small = _AUTOPILOT.time_offset
    misalignment: Small = _AUTOPILOT.misalignment
    gravity: Small = _AUTOPILOT.gravity
    reported: bool = True


class ViewSettings(_Section, frozen=True):
    """How the replay is served."""

    host: str = "127.0.0.1"
    port: Annotated[int, msgspec.Meta(ge=0, le=65535)] = 8080
    token: bool = False
    reanchor_s: NotNegative = 10.0
    map_url: str = "https://tile.openstreetmap.org/{z}/{x}/{y}.png"


class LiveSettings(_Section, frozen=True):
    """What a live link requests, and as whom."""

    imu_hz: Positive = 100.0
    attitude_hz: Positive = 50.0
    position_hz: Positive = 20.0
    window_min: Annotated[float, msgspec.Meta(ge=0.5, le=240)] = 10.0
    sysid: Annotated[int, msgspec.Meta(ge=1, le=254)] = 240
    compid: Annotated[int, msgspec.Meta(ge=1, le=255)] = 191


class Settings(_Section, frozen=True):
    """Everything that can be set."""

    log: LogSettings = LogSettings()
    integration: IntegrationSettings = IntegrationSettings()
    drift: DriftSettings = DriftSettings()
    autopilot: AutopilotSettings = AutopilotSettings()
    view: ViewSettings = ViewSettings()
    live: LiveSettings = LiveSettings()


def load_settings(path: str | Path | None = None) -> Settings:
    """The settings of a TOML file, defaults for what it does not say; all defaults without a file.

    Raises InputError when the file cannot be read, SettingsError for TOML that is none, an unknown key or a wrong
    value: the message names the file and the line.
    """
    if path is None:
        return Settings()
    try:
        values, text = read_toml(path)
    except OSError as error:
        raise InputError(
            f"cannot read the settings file {path}: {error}. Give --config the path of a TOML file."
        ) from None
    try:
        return msgspec.convert(values, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(
            f"{path}, line {_line(text, str(error))}: {error}. Every key is described in config/default.toml."
        ) from None


def _line(text: str, complaint: str) -> int:
    """The line of the key that msgspec complains about: "... unknown field `x` - at `$.drift`" or "at `$.drift.x`"."""
    place = re.search(r"at `\$\.?([^`]*)`", complaint)
    keys = re.findall(r"[^.\[\]]+", place[1]) if place else []
    keys = [key for key in keys if key != "..."]
    if unknown := re.search(r"unknown field `([^`]*)`", complaint):
        keys.append(unknown[1])
    table: list[str] = []
    best = 1
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*\[\s*([^\]]+?)\s*\]", line):
            table = _dotted(header[1])
            if table == keys:
                return number
            if table == keys[:1]:
                best = number
        elif match := re.match(r"\s*([\w.\"'-]+)\s*=", line):
            path = [*table, *_dotted(match[1])]
            if path == keys[: len(path)]:
                return number
    return best


def _dotted(key: str) -> list[str]:
    """The parts of a TOML key: drift.gap_s, 'drift'.gap_s."""
    return [part.strip(" '\"") for part in key.split(".")]
