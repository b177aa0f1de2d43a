"""The function that a worker runs: one log examined where it is. Only the path comes, only small rows go back.

And a report of each flight, into the folder of the results, where requested.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import re
import signal
import socket
import sys
import threading
import warnings
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path

import msgspec
import numpy as np

from companion.app.examination import Examination, Unexamined, examined_or_not
from companion.app.files import write
from companion.app.recording import Recording, read_recording
from companion.app.settings import Settings
from companion.documents import analysis_document
from companion.fleet.history import checks_of, gyros_of
from companion.fleet.journal import FlightRecord, LogRecord, Plan, printable, version_of
from companion.fleet.rows import arrow_tables, rows_of
from companion.fleet.search import FoundLog, digest_of
from companion.model import CompanionError, DataError, Flight, InputError
from companion.report import report_html
from companion.telemetry import id_parameters

_NO_CALENDAR_S = 4e9  # the year 2096


def examine_log(path: str, plan: Plan, known: Collection[str] = ()) -> bytes:
    """A LogRecord as JSON. With the sha256 alone when the content is one of `known`, which need no second look.

    Errors are rows: whatever is wrong with the log is in the record. What is wrong with this worker (it does not see
    the file, its program is another version) is there too, with `settled` False.
    """
    try:
        with limited(plan.memory_gb, plan.timeout_s), warnings.catch_warnings():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")  # as the command does
            record = _record(path, plan, known)
            with contextlib.suppress(ImportError):  # this worker writes nothing
                arrow_tables(rows_of([(FoundLog(path, 0, ""), record)]))  # what cannot be written is this log's error
            return msgspec.json.encode(record)
    except (Exception, TimeUpError) as error:  # noqa: BLE001  (the border between processes: not every exception survives the journey)
        digest = None
        with contextlib.suppress(OSError):
            digest = digest_of(path)
        return msgspec.json.encode(LogRecord(sha256=digest, error=_in_words(error)))


def _record(path: str, plan: Plan, known: Collection[str]) -> LogRecord:
    if complaint := _unfit(plan):
        return LogRecord(error=f"on {socket.gethostname()}: {complaint}", settled=False)
    try:
        digest = digest_of(path)
    except OSError as error:
        where = f"on {socket.gethostname()}: {printable(path)} cannot be read ({error.strerror})"
        return LogRecord(
            error=f"{where}. Every worker has to see the logs under the same path, with the right to read them.",
            settled=False,
        )
    if digest in known:
        return LogRecord(sha256=digest)
    settings = _settings(plan.settings)
    try:
        recording = read_recording(
            path,
            every_message=plan.folder is not None,  # a report has the rates of all
            **settings.log.options,
        )
        if not recording.flights:
            raise DataError(f"{recording.no_flight}.")
        flights = tuple(_flight(recording, flight, plan, settings, digest) for flight in recording.flights)
    except Exception as error:  # noqa: BLE001  (one bad log is a row, whatever it breaks)
        return LogRecord(sha256=digest, error=_in_words(error))
    return LogRecord(sha256=digest, format=recording.source.format, flights=flights)


def _flight(recording: Recording, flight: Flight, plan: Plan, settings: Settings, digest: str) -> FlightRecord:
    same = [other for other in recording.flights if other.vehicle == flight.vehicle]
    record = FlightRecord(
        vehicle=flight.vehicle,
        boot=flight.boot,
        duration_s=flight.duration,
        date_s=_date(flight),
        board=board_of(same),
        gyro_ids=sensor_ids(flight, "gyro"),
        accel_ids=sensor_ids(flight, "accel"),
        temperatures_degc=temperatures(flight),
        gyros=gyros_of(flight),
        checks=checks_of(flight),
    )
    try:
        examined = examined_or_not(flight, settings, imu=plan.imu, imu_model=plan.imu_model)
        (analysis,) = analysis_document(recording.source, examined)["flights"]
    except Exception as error:  # noqa: BLE001  (its other flights may be good)
        return msgspec.structs.replace(record, error=_in_words(error))
    record = msgspec.structs.replace(record, analysis=analysis)
    if plan.folder is None or isinstance(examined, Unexamined):
        return record
    try:
        page = write_report(Path(plan.folder), recording, examined, settings, digest)
    except Exception as error:  # noqa: BLE001  (the numbers are good)
        return msgspec.structs.replace(record, report_error=f"on {socket.gethostname()}: {_in_words(error)}")
    return msgspec.structs.replace(record, report=page)


def _date(flight: Flight) -> float | None:
    """When it began, s UNIX; None for a time that no calendar has."""
    if flight.epoch is None:
        return None
    date = flight.epoch.unix_s + flight.start
    return date if 0.0 <= date < _NO_CALENDAR_S else None


def _in_words(error: BaseException) -> str:
    """An error as text for a table."""
    if isinstance(error, CompanionError):
        return printable(str(error))
    if isinstance(error, OSError):
        return printable(f"{error.filename or 'a file'}: {error.strerror or error}")
    if isinstance(error, MemoryError | SystemError):  # the second is what C code makes of memory that it does not get
        return "it needs more memory than a log is given. Give it more: --memory GB --retry"
    return printable(f"the analysis failed with {type(error).__name__}: {error}. This is a bug in companion.")


@functools.lru_cache(maxsize=4)
def _settings(packed: bytes) -> Settings:
    return msgspec.msgpack.decode(packed, type=Settings)


def _unfit(plan: Plan) -> str | None:
    """Why this worker cannot do it as requested, if so."""
    try:
        own = version_of(_settings(plan.settings), plan.imu, plan.imu_model)
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


_FOLDER = "reports"


def write_report(folder: Path, recording: Recording, examined: Examination, settings: Settings, digest: str) -> str:
    """Write it, and return its place in the folder: named after the log and its content.

    Raises InputError when the folder is not to be seen from here, OSError when the file
    cannot be written.
    """
    if not folder.is_dir():
        raise InputError(f"the folder {folder} is not here: reports need a file system that all workers share.")
    flight = examined.flight
    which = "" if len(recording.flights) == 1 else f"-{flight.vehicle.sysid}.{flight.vehicle.compid}-{flight.boot}"
    stem = re.sub(r"[^\w.-]+", "_", recording.source.path.stem, flags=re.ASCII)[:80]
    name = f"{_FOLDER}/{stem}-{digest[:10]}{which}.html"
    (folder / _FOLDER).mkdir(exist_ok=True)
    page = report_html(examined, recording.source, settings, command=f"companion report {recording.source.path.name}")
    write(folder / name, page)
    return name


_SERIAL = re.compile(r"\b([0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8})\b|^([0-9a-f]{32})$")
"""ArduPilot's banner gives the processor's unique id so (AP_HAL_ChibiOS/Util.cpp, get_system_id); its simulator's is
32 digits."""


def sensor_ids(flight: Flight, sensor: str) -> dict[str, int]:
    """IMU message → the autopilot's id of its "gyro" or "accel", where the log tells it.

    The id holds bus, address and type of the part (AP_InertialSensor, DevTypes): two boards of a kind have the same.
    PX4's parameters name the sensors that were calibrated, in the order of that: where the log names the gyro that was
    read and this is another, nothing is said of its accelerometer.
    """
    known = flight.parameters
    ids = {}
    for name, track in flight.imus.items():
        gyro, named = (
            next((int(known[p]) for p in id_parameters(of, track.instance) if p in known), 0) for of in ("gyro", sensor)
        )
        if track.device_id and track.device_id != gyro:
            named = track.device_id if sensor == "gyro" else 0
        ids[name] = named
    return {name: number for name, number in ids.items() if number}


def board_of(flights: Iterable[Flight]) -> str | None:
    """The serial number of a vehicle's flight controller: that of its banner in any of its flights (sent once for a
    ground station), else BRD_SERIAL_NUM; None when neither is known.
    """
    number = 0.0
    for flight in flights:
        for sent in flight.texts:
            if match := _SERIAL.search(sent.text):
                return match[1] or match[2]
        number = flight.parameters.get("BRD_SERIAL_NUM", number)
    return str(int(number)) if number else None


def temperatures(flight: Flight) -> dict[str, float]:
    """IMU message → its median temperature over the flight, °C, where the log has it."""
    series = {name: flight.series.get(f"temperature:{name}") for name in flight.imus}
    read = {name: one["temperature_degc"] for name, one in series.items() if one is not None}
    finite = {name: values[np.isfinite(values)] for name, values in read.items()}
    return {name: float(np.median(values)) for name, values in finite.items() if len(values)}


class TimeUpError(BaseException):
    """The time of a log is up. No Exception, so that no handler in the analysis catches it."""


@contextlib.contextmanager
def limited(memory_gb: float, timeout_s: float) -> Iterator[None]:
    """Limits inside: MemoryError beyond so much more memory, InputError after so long.

    A log that exceeds them is an error in its row alone.
    """
    with _memory(memory_gb), _time(timeout_s):
        yield


@contextlib.contextmanager
def _memory(gigabytes: float) -> Iterator[None]:
    """Of the data of this process, on Linux; other systems do not count it so."""
    try:
        import resource  # noqa: PLC0415  (not on Windows)

        with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123
            used = int(file.read().split()[5]) * resource.getpagesize()
    except (ImportError, OSError):
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_DATA)
    most = used + round(gigabytes * 1e9)
    allowed = most if before[1] == resource.RLIM_INFINITY else min(most, before[1])
    resource.setrlimit(resource.RLIMIT_DATA, (allowed, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


@contextlib.contextmanager
def _time(seconds: float) -> Iterator[None]:
    """By an exception in this thread: signals are for the main thread, and a worker's tasks are not in it."""
    lock, over, working = threading.Lock(), [False], threading.get_ident()

    def interrupt() -> None:
        with lock:
            if not over[0]:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(working), ctypes.py_object(TimeUpError))

    timer = threading.Timer(seconds, interrupt)
    timer.daemon = True
    timer.start()
    try:
        yield
    except TimeUpError:
        raise InputError(
            f"it takes longer than the {seconds:g} s that a log is given. Give it more: --timeout S --retry"
        ) from None
    finally:
        with lock:
            over[0] = True
        timer.cancel()
