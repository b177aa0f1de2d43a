"""One log examined where it is: the function that a worker runs. Only the path comes, only small rows go back."""

from __future__ import annotations

import functools
import hashlib
import signal
import socket
from collections.abc import Collection
from pathlib import Path

import msgspec

from companion.documents import analysis_document, vehicle_object
from companion.errors import CompanionError, DataError
from companion.examination import examine
from companion.fleet.records import FlightRecord, LogRecord, Plan
from companion.fleet.sensors import board_of, sensor_ids, temperatures
from companion.fleet.version import version_of
from companion.recording import Recording, read_recording
from companion.settings import Settings
from companion.tracks import Flight

_UNFORESEEN = (ArithmeticError, AssertionError, AttributeError, LookupError, OSError, TypeError, ValueError)
"""What an error in this program looks like: it costs a row, not the run."""


def examine_log(path: str, plan: Plan, known: Collection[str] = ()) -> bytes:
    """A LogRecord as JSON. With the sha256 alone when the content is one of `known`, which need no second look.

    Errors are rows: whatever is wrong with the log is in the record. What is wrong with this worker (it does not see
    the file, its program is another version) is there too, with `settled` False.
    """
    return msgspec.json.encode(_record(path, plan, known))


def _record(path: str, plan: Plan, known: Collection[str]) -> LogRecord:
    if complaint := _unfit(plan):
        return LogRecord(error=f"on {socket.gethostname()}: {complaint}", settled=False)
    try:
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        where = f"on {socket.gethostname()}: {path} cannot be read ({error.strerror})"
        return LogRecord(
            error=f"{where}. Every worker has to see the logs under the same path, with the right to read them.",
            settled=False,
        )
    if digest in known:
        return LogRecord(sha256=digest)
    settings = _settings(plan.settings)
    try:
        recording = read_recording(path, dialect=settings.log.dialect, dequantise=settings.log.dequantise)
        if not recording.flights:
            raise DataError("no vehicle speaks in it: no telemetry of an autopilot was found.")
    except CompanionError as error:
        return LogRecord(sha256=digest, error=str(error))
    except (*_UNFORESEEN, MemoryError) as error:
        return LogRecord(sha256=digest, error=_unforeseen(error))
    flights = tuple(_flight(recording, flight, plan, settings) for flight in recording.flights)
    return LogRecord(sha256=digest, format=recording.source.format, flights=flights)


def _flight(recording: Recording, flight: Flight, plan: Plan, settings: Settings) -> FlightRecord:
    same = [other for other in recording.flights if other.vehicle == flight.vehicle]
    record = FlightRecord(
        vehicle=vehicle_object(flight),
        boot=flight.boot,
        duration_s=flight.duration,
        date_s=flight.epoch.unix_s + flight.start if flight.epoch else None,
        board=board_of(same),
        gyro_ids=sensor_ids(flight, "gyro"),
        accel_ids=sensor_ids(flight, "accel"),
        temperatures_degc=temperatures(flight),
    )
    try:
        examined = examine(flight, settings, imu=plan.imu, imu_model=plan.imu_model)
        (analysis,) = analysis_document(recording.source, examined).flights
    except CompanionError as error:
        return msgspec.structs.replace(record, error=str(error))
    except (*_UNFORESEEN, MemoryError) as error:
        return msgspec.structs.replace(record, error=_unforeseen(error))
    return msgspec.structs.replace(record, analysis=analysis)


def _unforeseen(error: Exception) -> str:
    return f"the analysis failed with {type(error).__name__}: {error}. This is a fault of companion: please report it."


@functools.lru_cache(maxsize=4)
def _settings(packed: bytes) -> Settings:
    return msgspec.msgpack.decode(packed, type=Settings)


@functools.lru_cache(maxsize=4)
def _version(packed: bytes, imu: str | None, imu_model: str | None) -> str:
    return version_of(_settings(packed), imu, imu_model)


def _unfit(plan: Plan) -> str | None:
    """Why this worker cannot do it as it was asked, if so."""
    try:
        own = _version(plan.settings, plan.imu, plan.imu_model)
    except (CompanionError, msgspec.ValidationError) as error:
        return str(error)
    if own != plan.version:
        return "another version of companion is installed here. Install the same on every machine."
    return None


def dask_setup(worker: object) -> None:
    """Called by Dask in each worker process that this program starts: Ctrl-C is for the program, which ends them."""
    del worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def decode(answer: bytes) -> LogRecord:
    """What `examine_log` gave."""
    return msgspec.json.decode(answer, type=LogRecord)
