"""Flights that lack tracks, or have hardly a sample of them: each ends as an answer or in a DataError.

Every two tracks meet with every two amounts (all samples, no track, a track of 0, 1 or 2): a pairwise covering array in
place of a billion combinations, for what fails does so by one or two things that are missing. The messages that tracks
are made of meet in the same way in a telemetry log.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import companion as c
from companion.app.examination import unexaminable
from companion.app.recording import Recording, Source, read_recording
from companion.cli.analyze import first_screen
from companion.documents import analysis_document, encode, info_document
from companion.model import (
    ActuatorTrack,
    AirspeedTrack,
    BiasTrack,
    ControlTrack,
    DataError,
    EstimatorReset,
    Flight,
    FlowTrack,
    InputError,
    RangeTrack,
    Series,
    TruthTrack,
    inventory,
    rows,
)
from companion.strapdown import motions
from companion.telemetry.flights import NEEDED
from companion.telemetry.sources import COLUMNS
from tests.flights import flown, seconds
from tests.tlogs import Writer, resting

pytestmark = pytest.mark.slow

Amount = int | None
"""Of samples."""

ALL, ABSENT = None, -1
AMOUNTS: Sequence[Amount] = (ALL, ABSENT, 0, 1, 2)

WITNESSES = (
    "gps", "compasses", "barometers", "position", "biases", "series", "control", "actuators", "airspeeds", "ranges",
    "flows", "truth",
)  # fmt: skip
SECONDS, HZ = 16.0, 20  # three windows of 5 s


def covering(factors: Sequence[str], amounts: Sequence[Amount]) -> Iterator[dict[str, Amount]]:
    """Rows in which every two factors have every two amounts; as many amounts as a prime number q.

    The lines y = i x + a of the plane over the integers modulo q, and the vertical ones, are an orthogonal array of
    q² rows and q + 1 factors (R. C. Bose 1938). More factors are told apart by a digit, and each digit has its rows.
    """
    q = len(amounts)
    digits = math.ceil(math.log(len(factors), q + 1))
    for digit, a, x in itertools.product(range(digits), range(q), range(q)):
        slopes = [n // (q + 1) ** digit % (q + 1) for n in range(len(factors))]
        yield {
            factor: amounts[a if slope == q else (slope * a + x) % q]
            for factor, slope in zip(factors, slopes, strict=True)
        }


def test_every_two_tracks_meet_with_every_two_amounts() -> None:
    rows = list(covering(WITNESSES, AMOUNTS))
    for a, b in itertools.combinations(WITNESSES, 2):
        assert len({(row[a], row[b]) for row in rows}) == len(AMOUNTS) ** 2


@cache
def whole() -> Flight:
    """A flight with every kind of track."""
    motion = motions.coning(
        seconds(SECONDS, HZ), angle=0.25, frequency=0.25, amplitude=(6.0, 5.0, 2.0), swing=(0.07, 0.11, 0.1)
    )
    flight, rng = flown(motion), np.random.default_rng(1)
    imu = flight.imu()
    t = imu.t[::2]
    count, ones = len(t), np.ones((len(t), 3))
    columns = {kind: 0.1 + 0.01 * rng.random((count, len(names))) for kind, names in COLUMNS.items()}
    columns["estimator"][:, -1] = 0b11111
    return replace(
        flight,
        imus={"RAW_IMU": imu, "SCALED_IMU2": replace(imu, source="SCALED_IMU2", instance=1)},
        airspeeds=(AirspeedTrack(t, 10.0 * ones[:, 0], np.full(count, np.nan), 60.0 * ones[:, 0], 20.0 * ones[:, 0]),),
        ranges=(RangeTrack(t, 5.0 + rng.random(count), np.full(count, 0.1), np.ones(count), 25, 0.1, 40.0),),
        flows=(FlowTrack(t, rng.random((count, 2)), 0.1 * ones, np.full(count, 0.1), np.full(count, 200.0), t),),
        biases=(BiasTrack(t, 1e-3 * ones, 1e-2 * ones, 1e-4 * ones, 1e-2 * ones, "XKF1[0]"),),
        control=ControlTrack(t, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), "ATTITUDE_TARGET"),
        actuators=ActuatorTrack(t, rng.random((count, 4)), "SERVO_OUTPUT_RAW"),
        truth=TruthTrack(motion.t, motion.q_ned_frd, motion.velocity, motion.position),
        series={kind: Series(t, values, COLUMNS[kind], kind.upper()) for kind, values in columns.items()},
        resets=(EstimatorReset(float(t[40]), "heading"),),
    )


def first(track: Any, amount: Amount) -> Any:
    """The first samples of a track, or of each of several."""
    if amount is ALL:
        return track
    if isinstance(track, Mapping):
        return {name: first(one, amount) for name, one in track.items()} if amount >= 0 else {}
    if isinstance(track, tuple):
        return tuple(first(one, amount) for one in track) if amount >= 0 else ()
    if amount < 0:
        return None
    return rows(track, slice(amount))


def examined(flight: Flight, source: Source) -> None:
    """Everything that is said of a flight."""
    repr(flight)
    inventory(flight)
    lacking = unexaminable(flight)
    if lacking is not None:
        encode(analysis_document(source, lacking))
        return
    with contextlib.suppress(DataError):
        found = c.examine(flight)
        first_screen(found, 80)
        encode(analysis_document(source, found))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    return read_recording(resting(tmp_path_factory.mktemp("source") / "flight.tlog")).source


ROWS = [
    pytest.param(row, marks=[pytest.mark.long] if number % 3 else [])
    for number, row in enumerate(covering(WITNESSES, AMOUNTS))
]
"""Every third of them has every amount of every track, if not every two."""


@pytest.mark.parametrize("row", ROWS)
def test_a_flight_without_some_tracks_is_examined(row: Mapping[str, Amount], source: Source) -> None:
    flight = whole()
    examined(replace(flight, **{name: first(getattr(flight, name), amount) for name, amount in row.items()}), source)


@pytest.mark.parametrize("imu", [ALL, ABSENT, 0, 1, 2, 25])
@pytest.mark.parametrize("attitude", [ALL, ABSENT, 0, 1, 2, 7])
def test_a_flight_with_hardly_an_imu_or_attitude_is_examined(imu: Amount, attitude: Amount, source: Source) -> None:
    flight = whole()
    short = replace(flight, imus=first(flight.imus, imu), attitude=first(flight.attitude, attitude))
    examined(short, source)
    examined(replace(short, gps=(), events=(), position=None), source)
    examined(replace(short, duration=0.0), source)


MESSAGES = sorted(NEEDED)
_SPARSE_HZ = {"HEARTBEAT": 1.0, "PARAM_VALUE": 1.0, "STATUSTEXT": 0.5, "AUTOPILOT_VERSION": 0.5, "GPS_RAW_INT": 5.0}
_CLOCKS = {"time_boot_ms": 1e3, "time_usec": 1e6, "time_unix_usec": 1e6}
_BOOT_S = 20.0


@cache
def packets() -> dict[str, list[tuple[float, bytes]]]:
    """Of every message that a flight is made of: times (s) and packets of a vehicle that sways."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    sent: dict[str, list[tuple[float, bytes]]] = {name: [] for name in MESSAGES}
    for name, own in sent.items():
        kind = getattr(mavlink, f"MAVLink_{name.lower()}_message")
        for t in np.arange(0.0, SECONDS, 1.0 / _SPARSE_HZ.get(name, HZ)).tolist():
            own.append((t, kind(**_values(kind, t) | _swaying(t).get(name, {})).pack(sender)))
    return sent


def _values(kind: Any, t: float) -> dict[str, Any]:
    """Of every field: none is zero, none of a number stays the same."""
    values: dict[str, Any] = {}
    for i, (field, of) in enumerate(zip(kind.fieldnames, kind.fieldtypes, strict=True)):
        count = kind.array_lengths[kind.ordered_fieldnames.index(field)]
        value = 0.1 + 0.01 * math.sin(t + i) if of in ("float", "double") else 1 + round(10 * t + i) % 3
        values[field] = b"x" if of == "char" else [value] * count if count else value
    return values | {field: round((_BOOT_S + t) * unit) for field, unit in _CLOCKS.items() if field in values}


def _swaying(t: float) -> dict[str, dict[str, Any]]:
    """What the messages that matter most say."""
    roll, rate = 0.2 * math.sin(t), 0.2 * math.cos(t)
    q = [math.cos(0.5 * roll), math.sin(0.5 * roll), 0.0, 0.0]
    felt = {"xacc": 0.0, "yacc": 9.8 * math.sin(roll), "zacc": -9.8 * math.cos(roll)}
    imu = {axis: round(value * 102) for axis, value in felt.items()} | {"xgyro": round(rate * 1e3), "xmag": 200}
    fix = {"lat": 474_000_000 + round(10 * math.sin(t)), "lon": 85_000_000, "alt": 400_000, "fix_type": 3}
    place = {"latitude": 474_000_000, "longitude": 85_000_000, "altitude": 400_000}
    return {
        "RAW_IMU": imu,
        "SCALED_IMU": imu,
        "SCALED_IMU2": imu,
        "SCALED_IMU3": imu,
        "HIGHRES_IMU": {**felt, "xgyro": rate, "id": 0},
        "ATTITUDE": {"roll": roll, "pitch": 0.0, "yaw": 0.5, "rollspeed": rate},
        "ATTITUDE_QUATERNION": {f"q{i + 1}": value for i, value in enumerate(q)},
        "ATTITUDE_TARGET": {"q": q},
        "ODOMETRY": {"q": q},
        "HIL_STATE_QUATERNION": {"attitude_quaternion": q},
        "GLOBAL_POSITION_INT": {name: fix[name] for name in ("lat", "lon", "alt")},
        "GPS_RAW_INT": fix,
        "GPS2_RAW": fix | {"fix_type": 0},
        "HOME_POSITION": place,
        "GPS_GLOBAL_ORIGIN": place,
        **{f"SCALED_PRESSURE{n}": {"press_abs": 950.0 + 0.1 * math.sin(t)} for n in ("", "2", "3")},
        "HEARTBEAT": {"type": 2, "autopilot": 3, "base_mode": 128 if t > 2.0 else 0},
        "PARAM_VALUE": {"param_id": b"INS_GYR_ID", "param_value": 3e6, "param_type": 6},
        "SYSTEM_TIME": {"time_unix_usec": round((1.7e9 + t) * 1e6)},
    }


@pytest.mark.parametrize("row", list(covering(MESSAGES, (ALL, ABSENT, 1, 2, 30))))
def test_a_log_without_some_messages_is_read(row: Mapping[str, Amount], tmp_path: Path) -> None:
    log = Writer(tmp_path / "flight.tlog")
    some = (packets()[name][: None if amount is ALL else max(amount, 0)] for name, amount in row.items())
    for t, packet in sorted(itertools.chain.from_iterable(some)):
        log.bytes(t, packet)
    with contextlib.suppress(InputError):  # of one without any message
        seen(read_recording(log.close()))


def seen(recording: Recording) -> None:
    """Everything that is made when it is asked for."""
    encode(info_document(recording))
    for flight in recording.flights:
        for kind in (flight.gps, flight.compasses, flight.barometers, flight.airspeeds, flight.ranges, flight.flows):
            repr(tuple(kind))
        repr((dict(flight.series), tuple(flight.biases), tuple(flight.notes), tuple(flight.parameter_changes)))
        unexaminable(flight)
