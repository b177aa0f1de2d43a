"""The JSON that the commands print, as types. docs/json.md describes it; keys are added, never renamed."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from companion.analysis import Drift, DriftRow, Statistic
from companion.recording import Source
from companion.tracks import Flight, ImuTrack

SCHEMA = 1


class LogObject(msgspec.Struct, frozen=True):
    """What was read."""

    path: str
    size_bytes: int
    frames: int
    bad_crc_frames: int
    skipped_bytes: int


class VehicleObject(msgspec.Struct, frozen=True):
    """Who flew."""

    sysid: int
    compid: int
    autopilot: str
    type: str
    firmware: str


class StatsObject(msgspec.Struct, frozen=True):
    """How a message arrived."""

    count: int
    rate_hz: float | None
    longest_gap_s: float | None
    duplicates: int


class ReferenceObject(msgspec.Struct, frozen=True):
    """The messages that the autopilot's state is taken from."""

    attitude: str | None
    position: str | None


class InfoFlight(msgspec.Struct, frozen=True):
    """A flight in `companion info`."""

    vehicle: VehicleObject
    boot: int
    start_s: float
    duration_s: float
    default_imu: str | None
    reference: ReferenceObject
    notes: tuple[str, ...]
    messages: Mapping[str, StatsObject]


class Info(msgspec.Struct, frozen=True, kw_only=True):
    """`companion info --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[InfoFlight]


class ImuObject(msgspec.Struct, frozen=True):
    """An IMU message of a flight."""

    message: str
    samples: int
    rate_hz: float
    gaps: int
    longest_gap_s: float | None
    duplicates: int


class StatisticObject(msgspec.Struct, frozen=True):
    """An error over windows."""

    median: float
    p95: float
    max: float


class DriftObject(msgspec.Struct, frozen=True):
    """Drift at one horizon."""

    horizon_s: float
    windows: int
    excluded: Mapping[str, int]
    attitude_deg: StatisticObject | None
    velocity_mps: StatisticObject | None
    position_m: StatisticObject | None


class AnalyzeFlight(msgspec.Struct, frozen=True):
    """A flight in `companion analyze`."""

    vehicle: VehicleObject
    boot: int
    duration_s: float
    imu: list[ImuObject]
    reference: ReferenceObject
    used_imu: str
    method: str
    middle: str
    gravity_mps2: float
    notes: tuple[str, ...]
    drift: list[DriftObject]


class Analysis(msgspec.Struct, frozen=True, kw_only=True):
    """`companion analyze --json`."""

    schema: int = SCHEMA
    log: LogObject
    flights: list[AnalyzeFlight]


def encode(document: Info | Analysis) -> str:
    """Indented JSON text. Non-finite numbers become null."""
    return msgspec.json.format(msgspec.json.encode(document), indent=2).decode()


def log_object(source: Source) -> LogObject:
    """The "log" key."""
    return LogObject(
        path=str(source.path),
        size_bytes=source.size_bytes,
        frames=source.frames,
        bad_crc_frames=source.bad_crc_frames,
        skipped_bytes=source.skipped_bytes,
    )


def info_flight(flight: Flight) -> InfoFlight:
    """One of the "flights" of `info`."""
    return InfoFlight(
        vehicle=_vehicle(flight),
        boot=flight.boot,
        start_s=flight.start,
        duration_s=flight.duration,
        default_imu=flight.default_imu,
        reference=_reference(flight),
        notes=flight.notes,
        messages={
            name: StatsObject(count=s.count, rate_hz=s.rate_hz, longest_gap_s=s.longest_gap_s, duplicates=s.duplicates)
            for name, s in flight.messages.items()
        },
    )


def analyze_flight(flight: Flight, table: Drift, gaps: Mapping[str, int], gravity: float) -> AnalyzeFlight:
    """One of the "flights" of `analyze`; gaps: holes of each IMU message, gravity: m/s²."""
    return AnalyzeFlight(
        vehicle=_vehicle(flight),
        boot=flight.boot,
        duration_s=flight.duration,
        imu=[_imu(flight, name, track, gaps[name]) for name, track in flight.imus.items()],
        reference=_reference(flight),
        used_imu=table.imu,
        method=table.method,
        middle=table.middle,
        gravity_mps2=gravity,
        notes=(*flight.notes, *table.notes),
        drift=[_drift(row) for row in table.rows],
    )


def _vehicle(flight: Flight) -> VehicleObject:
    v = flight.vehicle
    return VehicleObject(sysid=v.sysid, compid=v.compid, autopilot=v.autopilot, type=v.type, firmware=v.firmware)


def _reference(flight: Flight) -> ReferenceObject:
    return ReferenceObject(
        attitude=flight.attitude.source if flight.attitude else None,
        position=flight.position.source if flight.position else None,
    )


def _imu(flight: Flight, name: str, track: ImuTrack, gaps: int) -> ImuObject:
    stats = flight.messages[name]
    return ImuObject(
        message=name,
        samples=len(track),
        rate_hz=track.rate_hz,
        gaps=gaps,
        longest_gap_s=stats.longest_gap_s,
        duplicates=stats.duplicates,
    )


def _drift(row: DriftRow) -> DriftObject:
    return DriftObject(
        horizon_s=row.horizon_s,
        windows=row.windows,
        excluded=row.excluded,
        attitude_deg=_statistic(row.attitude_deg),
        velocity_mps=_statistic(row.velocity_mps),
        position_m=_statistic(row.position_m),
    )


def _statistic(statistic: Statistic | None) -> StatisticObject | None:
    if statistic is None:
        return None
    return StatisticObject(median=statistic.median, p95=statistic.p95, max=statistic.max)
