"""The record of an examined log, as a worker returns it and the journal keeps it.

With a digest of the program's analysis and of the settings that made it: rows of another version are made anew.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import msgspec

from companion.analysis import Check
from companion.app.sensors import load_imu_spec
from companion.app.settings import Settings
from companion.documents import Document
from companion.fleet.limits import MEMORY_GB, TIMEOUT_S
from companion.installation import data_folder
from companion.model import Vehicle


class FlightRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One flight of a log: who flew, with which sensors, and the analysis that `companion analyze --json` prints."""

    vehicle: Vehicle
    boot: int
    duration_s: float
    date_s: float | None = None  # UNIX time of the flight's beginning, s
    board: str | None = None  # serial number of the flight controller
    gyro_ids: Mapping[str, int] = {}  # IMU message → the autopilot's id of the sensor behind it
    accel_ids: Mapping[str, int] = {}
    temperatures_degc: Mapping[str, float] = {}  # IMU message → median over the flight
    gyros: str = ""  # the ids of all gyros that the parameters name
    checks: tuple[Check, ...] = ()  # those before take-off, where it stands
    analysis: Document | None = None
    error: str | None = None  # why there is no analysis
    report: str | None = None  # its page, relative to the folder of the results
    report_error: str | None = None  # why it was not written


class LogRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One log. Without flights, `error` has the reason."""

    sha256: str | None = None  # None when it could not be read
    format: str | None = None
    flights: tuple[FlightRecord, ...] = ()
    error: str | None = None
    settled: bool = True  # False: not the log's own fault, so another run tries again


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """The options of a run, sent to the workers with each path."""

    version: str  # of program and settings: `version_of`
    settings: bytes  # Settings as MessagePack
    imu: str | None = None
    imu_model: str | None = None
    folder: str | None = None  # of the results, to write reports into; None: no reports
    memory_gb: float = MEMORY_GB  # for one log
    timeout_s: float = TIMEOUT_S  # for one log


MAKING = {
    "model", "mavlink", "installation", "logs", "telemetry", "strapdown", "constants.healthy", "constants.harm",
    "constants.priors", "constants.num", "constants.check", "estimation", "analysis", "app.resources", "app.toml_file",
    "app.settings", "app.sensors", "app.correction", "app.recording", "app.examination", "documents", "fleet",
}  # fmt: skip
"""The parts of the program that determine the rows."""

_SHOWING = ("view", "live")  # settings that change no number


def version_of(settings: Settings, imu: str | None, imu_model: str | None) -> str:
    """A digest of everything that the rows of a log depend on, beside the log.

    Raises InputError or SettingsError for an imu_model that is none.
    """
    known = msgspec.to_builtins(settings)
    for section in _SHOWING:
        known.pop(section, None)
    spec = repr(load_imu_spec(imu_model)) if imu_model else None
    made_of = msgspec.json.encode([_program_version(), known, imu, spec], order="sorted")
    return hashlib.sha256(made_of).hexdigest()[:16]


@functools.cache
def _program_version() -> str:
    """A digest of the source that makes the numbers, so that any change of it is noticed, released or not."""
    package = Path(str(files("companion")))
    parts = tuple(f"{part}." for part in MAKING)
    sources = [
        path for path in sorted(package.rglob("*.py")) if ".".join(path.relative_to(package).parts).startswith(parts)
    ]
    digest = hashlib.sha256()
    for path in [*sources, *sorted((data_folder("config") / "imu").glob("*.toml"))]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]
