"""What is known of a log after it was examined: what travels back from a worker and is kept in the journal."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from companion.documents import schema


class FlightRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One flight of a log: who flew, with which sensors, and the analysis that `companion analyze --json` prints."""

    vehicle: schema.VehicleObject
    boot: int
    duration_s: float
    date_s: float | None = None  # UNIX time of the flight's beginning, s
    board: str | None = None  # serial number of the flight controller
    gyro_ids: Mapping[str, int] = {}  # IMU message → the autopilot's id of the sensor behind it
    accel_ids: Mapping[str, int] = {}
    temperatures_degc: Mapping[str, float] = {}  # IMU message → median over the flight
    analysis: schema.AnalyzeFlight | None = None
    error: str | None = None  # why there is no analysis
    report: str | None = None  # its page, relative to the folder of the results
    report_error: str | None = None  # why it was not written


class LogRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One log. Without flights, `error` says why."""

    sha256: str | None = None  # None when it could not be read
    format: str | None = None
    flights: tuple[FlightRecord, ...] = ()
    error: str | None = None
    settled: bool = True  # False: not the log's own fault, so another run tries again


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """How every log of a run is examined: travels to the workers with each path."""

    version: str  # of program and settings: `version_of`
    settings: bytes  # Settings as MessagePack
    imu: str | None = None
    imu_model: str | None = None
    folder: str | None = None  # of the results, to write reports into; None: no reports
    memory_gb: float = 4.0  # for one log
    timeout_s: float = 600.0  # for one log
