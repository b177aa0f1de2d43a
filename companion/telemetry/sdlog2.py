"""PX4's log before .ulg (sdlog2, .px4log) → its flight: records as ArduPilot's declare themselves, in SI.

A TIME record has the time of those that follow it. Source: PX4 v1.0 `src/modules/sdlog2/sdlog2.c`, `sdlog2_messages.h`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from companion.logs import Records
from companion.model import Event, Flight, ImuTrack, from_euler
from companion.telemetry.aiding import aiding_tracks
from companion.telemetry.clock import epoch_of
from companion.telemetry.control import control_of
from companion.telemetry.events import arming, in_order
from companion.telemetry.flights import arrival
from companion.telemetry.parameters import UNKNOWN, identity, possible, px4_vehicle, setting_names, values_of
from companion.telemetry.samples import attitude_track, attitudes, imu_track, not_zero, place, position_track
from companion.telemetry.sources import SDLOG2_SOURCES, Raw, raw_series, series_of

_CLOCK = "TIME"
_IMUS = ("IMU", "IMU1", "IMU2")
_VALID = 0b1111  # LPOS.PFlg: horizontal position, height, and the velocities of both
_GLOBAL = 0b10000
_ARMED = 2  # STAT.ArmS

_NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(_IMUS, ("GyroX", "GyroY", "GyroZ", "AccX", "AccY", "AccZ")),
    "ATT": ("Roll", "Pitch", "Yaw", "RollRate", "PitchRate", "YawRate"),
    "LPOS": ("X", "Y", "Z", "VX", "VY", "VZ", "PFlg", "RLat", "RLon", "RAlt"),
    "ATSP": ("RollSP", "PitchSP", "YawSP"),
    "STAT": ("ArmS",),
    "GPS": ("GPSTime", "Fix"),
    "PARM": ("Value",),
}
"""Columns that these records must have."""

SDLOG2_RECORDS = frozenset({_CLOCK, *_NUMBERS, *(row.name for row in SDLOG2_SOURCES)})
"""Records whose fields a flight is made of."""


def is_sdlog2(records: Mapping[str, Records]) -> bool:
    """Whether a log that declares itself as ArduPilot's is PX4's."""
    return _CLOCK in records and records[_CLOCK].layout.has_numbers("StartTime")


def sdlog2_flight(read: Mapping[str, Records], vehicle_types: Mapping[int, str]) -> Flight:
    """The one flight of the log; vehicle_types names the values of MAV_TYPE."""
    records, notes = _timed(read), list[str]()
    parameters: dict[str, float] = {}
    if (sent := records.get("PARM")) is not None:
        names = sent["Name"].tolist()
        parameters = values_of(names, possible(names, sent["Value"].astype(np.float64), notes))
    imus = {name: _imu(records[name], i, notes) for i, name in enumerate(_IMUS) if name in records}
    ends = [(float(one.t.min()), float(one.t.max())) for one in records.values() if len(one)]
    begin, end = min(low for low, _ in ends), max(high for _, high in ends)
    attitude = position = zero = control = None
    if (one := records.get("ATT")) is not None:
        keep, t, q = attitudes(one.t, from_euler(*one.columns("Roll", "Pitch", "Yaw").T))
        attitude = attitude_track("ATT", t, q, one.columns("RollRate", "PitchRate", "YawRate")[keep], notes)
    if (one := records.get("LPOS")) is not None:
        good = (one["PFlg"] & _VALID) == _VALID
        where, speed = one.columns("X", "Y", "Z"), one.columns("VX", "VY", "VZ")
        position = position_track("LPOS", one.t, where, speed, good, notes)
        known = np.flatnonzero(one["PFlg"] & _GLOBAL)
        zero = place(*(float(one[name][known[0]]) for name in ("RLat", "RLon", "RAlt"))) if len(known) else None
    if (one := records.get("ATSP")) is not None:
        control = control_of("ATSP", one.t, from_euler(*one.columns("RollSP", "PitchSP", "YawSP").T))
    gps = records.get("GPS")
    kind = vehicle_types.get(identity(parameters, "MAV_TYPE", otherwise=-1), UNKNOWN)
    series = series_of(
        raw_series(row, row.name, one.t, partial(_column, one), instance=row.instance, notes=notes)
        for row in SDLOG2_SOURCES
        if (one := records.get(row.name)) is not None
    )
    return Flight(
        vehicle=px4_vehicle(parameters, kind),
        settings=setting_names("PX4"),
        boot=1,
        start=begin,
        duration=end - begin,
        imus={name: track for name, track in imus.items() if len(track)},
        attitude=attitude,
        position=position,
        origin=zero,
        epoch=None if gps is None else epoch_of(gps["GPSTime"] * 1e-6, gps.t, "GPS"),
        series=series,
        events=_arming(records.get("STAT")),
        parameters=parameters,
        messages={name: arrival(one.t, 0) for name, one in records.items()},
        on_board=True,
        control=control,
        **aiding_tracks(series, notes),
    )


def _timed(read: Mapping[str, Records]) -> dict[str, Records]:
    """The records whose columns are read, with the time of the TIME record before each."""
    clock = read[_CLOCK]
    t = clock["StartTime"] * 1e-6
    whole = {
        name: one
        for name, one in read.items()
        if len(one) and one.rows.dtype.names and one.layout.has_numbers(*_NUMBERS.get(name, ()))
    }
    last = {name: np.maximum(np.searchsorted(clock.offset, one.offset) - 1, 0) for name, one in whole.items()}
    return {name: replace(one, sender_s=t[last[name]]) for name, one in whole.items() if name != _CLOCK}


def _imu(one: Records, instance: int, notes: list[str]) -> ImuTrack:
    gyro, accel = (one.columns(*(f"{of}{axis}" for axis in "XYZ")) for of in ("Gyro", "Acc"))
    return replace(imu_track(one.name, one.t, gyro, accel, not_zero(gyro, accel), notes), instance=instance)


def _column(one: Records, field: str) -> Raw | None:
    return one.in_unit(field) if one.layout.has_numbers(field) else None


def _arming(status: Records | None) -> tuple[Event, ...]:
    return () if status is None else in_order(arming(status.t, np.asarray(status["ArmS"] == _ARMED)))
