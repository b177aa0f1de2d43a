"""From a file to its flights: the one way in for logs, whatever their format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from companion.installation import log_path
from companion.logs import (
    MOST_BYTES,
    DataflashLog,
    Log,
    Ulog,
    log_format,
    read_dataflash,
    read_dataflash_text,
    read_tlog,
    read_ulog,
)
from companion.mavlink import DEFAULT_DIALECT, Dialect, load_dialect
from companion.model import Flight, SettingsError
from companion.telemetry import (
    NEEDED,
    RECORDS,
    SDLOG2_RECORDS,
    TOPICS,
    NonVehicle,
    dataflash_flights,
    flights,
    is_sdlog2,
    sdlog2_flight,
    ulog_flight,
    why_no_flight,
)


@dataclass(frozen=True, slots=True)
class Source:
    """What was read, and what of it could not be."""

    path: Path  # as it is called
    format: str  # "tlog", "raw" (MAVLink without stamps), "dataflash", "dataflash text" or "ulog"
    size_bytes: int  # of the file
    frames: int  # MAVLink frames with a right checksum, or messages of an on-board log
    content_bytes: int = 0  # of what is in it, which is more where it is compressed
    trouble: str = ""  # why the rest of it could not be decompressed
    bad_crc_frames: int = 0
    skipped_bytes: int = 0  # that belong to no frame
    unknown_frames: Mapping[int, int] = field(default_factory=dict)  # message id that the dialect lacks → count
    speakers: Mapping[str, Mapping[str, int]] = field(default_factory=dict)  # SYSID:COMPID → message → count
    kept_in: Path | None = None  # where its bytes are while the command runs, where that is not its name

    @property
    def file(self) -> Path:
        """Where its bytes can be read."""
        return self.kept_in or self.path


@dataclass(frozen=True, slots=True)
class Recording:
    """A log and the flights found in it."""

    source: Source
    flights: tuple[Flight, ...]
    bystanders: tuple[NonVehicle, ...] = ()  # who speaks in it and is no vehicle
    no_flight: str = "no vehicle found: it has no telemetry of an autopilot"  # why, where there are no flights

    @property
    def unread_senders(self) -> int:
        """How many more speak in it, and were not looked at: only those with the most messages are."""
        read = {(f.vehicle.sysid, f.vehicle.compid) for f in self.flights}
        read |= {(other.sysid, other.compid) for other in self.bystanders}
        return max(0, len(self.source.speakers) - len(read))


def read_recording(
    path: str | Path,
    *,
    dialect: str = DEFAULT_DIALECT,
    dequantise: bool = False,
    every_message: bool = False,
    core: int | None = None,
    progress: Callable[[int], None] | None = None,
    max_size_gb: float = MOST_BYTES * 1e-9,
) -> Recording:
    """The flights of a .tlog, an ArduPilot .bin or .log, or a PX4 .ulg: one per vehicle and boot, in SI, FRD and NED.

    path: "demo" is the bundled flight.

    The format is detected from the file's first bytes, compressed (.gz, .zst) or not. A damaged log is read as far as
    possible; `Recording.source` has the counts. dequantise: see `config/default.toml`. every_message: read
    the fields of messages too that no track is made of, so that `Flight.messages` knows their rates by the vehicle's
    own clock. core: of ArduPilot's EKF, to compare with, which a .bin has more than one of; None: the one that flew.
    progress: called with the bytes of each piece that was read. max_size_gb: of content, where the file is compressed.

    Raises InputError when there is no such file or nothing in it that can be read, SettingsError for an unknown
    dialect or a core where there are none, DataError for a core that the log has not.
    """
    path = log_path(path)
    spoken = load_dialect(dialect)
    most_bytes = round(max_size_gb * 1e9)
    kind = log_format(path)
    if core is not None and not kind.startswith("dataflash"):
        raise SettingsError(
            f"{path} is no on-board log of ArduPilot (.bin), and only those have the estimates of every EKF core. "
            "Leave --core out, or name the .bin of this flight."
        )
    if kind == "ulog":
        return _read_ulog(path, spoken, progress, most_bytes)
    if kind.startswith("dataflash"):
        return _read_dataflash(path, kind, spoken, core, progress, most_bytes)
    log = read_tlog(
        path, dialect=dialect, names=None if every_message else NEEDED, progress=progress, most_bytes=most_bytes
    )
    telemetry = {"bad_crc_frames": log.bad_crc_frames, "unknown_frames": log.unknown_frames}
    source, messages = _source(log, speakers=_senders(log), **telemetry), dict(log.messages)
    del log  # `flights` lets go of what it has read
    of_log, others = flights(messages, spoken, dequantise=dequantise)
    return Recording(source, tuple(of_log), tuple(others))


def _read_ulog(path: Path, dialect: Dialect, progress: Callable[[int], None] | None, most_bytes: int) -> Recording:
    log = read_ulog(path, names=TOPICS, progress=progress, most_bytes=most_bytes)
    source, topics = _source(log), list(log.topics)
    log = replace(log, topics=())  # `ulog_flight` lets go of what it has read
    return Recording(source, (ulog_flight(log, topics, dialect.enum_names("MAV_TYPE")),))


def _read_dataflash(
    path: Path, kind: str, dialect: Dialect, core: int | None, progress: Callable[[int], None] | None, most_bytes: int
) -> Recording:
    read = read_dataflash if kind == "dataflash" else read_dataflash_text
    log = read(path, names=RECORDS | SDLOG2_RECORDS, progress=progress, most_bytes=most_bytes)
    source = _source(log)
    if is_sdlog2(log.messages):
        return Recording(source, (sdlog2_flight(log.messages, dialect.enum_names("MAV_TYPE")),))
    records, undecoded, nothing = dict(log.messages), log.undecoded, why_no_flight(log.messages)
    del log  # `dataflash_flights` lets go of what it has read
    made = dataflash_flights(records, dialect, core=core, undecoded=undecoded)
    return Recording(source, made) if made else Recording(source, (), no_flight=nothing)


def open_log(
    path: str | Path, *, dialect: str = DEFAULT_DIALECT, dequantise: bool = False, core: int | None = None
) -> list[Flight]:
    """The flights of a log, as `read_recording` gives them: an empty list when no vehicle speaks in it.

    path: "demo" is the bundled flight.

    >>> import companion as c
    >>> (flight,) = c.open_log("tlogs/copter-hover-100hz.tlog")
    >>> flight.vehicle.type, list(flight.imus), flight.attitude.source
    ('QUADROTOR', ['RAW_IMU', 'SCALED_IMU2'], 'ATTITUDE')
    >>> flight.imu().gyro.shape == (len(flight.imu()), 3)
    True
    """
    return list(read_recording(path, dialect=dialect, dequantise=dequantise, core=core).flights)


def usable_samples(flight: Flight) -> int:
    """IMU samples that there is an attitude to compare with."""
    name = flight.default_imu
    if name is None:
        return 0
    return len(flight.imus[name]) if flight.attitude is not None else 1


def _source(log: Log | DataflashLog | Ulog, **more: Any) -> Source:
    names = ("path", "size_bytes", "frames", "content_bytes", "trouble", "skipped_bytes")
    return Source(format=log.kind, **{name: getattr(log, name) for name in names}, **more)


def _senders(log: Log) -> dict[str, dict[str, int]]:
    """SYSID:COMPID → message → count."""
    senders: dict[str, dict[str, int]] = {}
    for name, messages in log.messages.items():
        for (sysid, compid), count in messages.senders().items():
            senders.setdefault(f"{sysid}:{compid}", {})[name] = count
    return senders
