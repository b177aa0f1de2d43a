"""The newest samples of a flight that is known already: three messages in place of all that it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from companion.mavlink import Messages
from companion.model import Array, AttitudeTrack, Flight, ImuTrack, PositionTrack
from companion.telemetry import convert
from companion.telemetry.clock import device_time
from companion.telemetry.imu_facts import known_ranges, with_facts

_AHEAD_S = 5.0  # of what is known: a time that is further on than that is none of this flight's, or after a hole
_SAME_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class NewestTracks:
    """The end of a flight: samples that are known already, and those that have come since."""

    imu: ImuTrack
    attitude: AttitudeTrack
    position: PositionTrack | None  # None where the flight has none


def sources(flight: Flight, imu: str) -> tuple[str, ...]:
    """The messages that its reckoning and what that is compared with come from."""
    attitude = (flight.attitude.source,) if flight.attitude is not None else ()
    return (imu, *attitude, *((flight.position.source,) if flight.position is not None else ()))


def newest_tracks(
    flight: Flight, imu: str, messages: Mapping[str, Messages], *, dequantise: bool = False
) -> NewestTracks | None:
    """The tracks of these messages, by name: the last of those that the flight was made of, and what has come since.

    None where they cannot simply go on from it: after a reboot or a hole, where their times are not those of the
    flight, or where one of them says nothing. Then the whole flight is to be looked at.
    """
    turn = convert.trim(flight.parameters) if flight.vehicle.autopilot == "ARDUPILOTMEGA" else None
    attitude = position = None
    track: ImuTrack | None = None
    for name in sources(flight, imu):
        sent = _of_vehicle(flight, messages.get(name))
        t = None if sent is None else device_time(sent)
        if sent is None or t is None or len(t) < 2:
            return None
        if name == imu:
            ranges = known_ranges(flight.vehicle, flight.parameters, flight.imus[imu].instance)
            track, _ = convert.imu_track(sent, t, dequantise=dequantise, ranges=ranges)
            if track is None:
                return None
            track = with_facts(track, flight.vehicle, flight.parameters)
            track = track if turn is None else convert.turned(track, turn[0])
        elif name.startswith("ATTITUDE"):
            attitude, _ = convert.attitude_track(sent, t)
        elif name == "LOCAL_POSITION_NED":
            position, _ = convert.position_track(sent, t)
        else:
            return None  # a position on the globe is seen from where the flight began
    if track is None or attitude is None or flight.attitude is None:
        return None
    pairs = [(track.t, flight.imus[imu].t), (attitude.t, flight.attitude.t)]
    if position is not None and flight.position is not None:
        pairs.append((position.t, flight.position.t))
    return NewestTracks(track, attitude, position) if all(_goes_on(*pair) for pair in pairs) else None


def _of_vehicle(flight: Flight, sent: Messages | None) -> Messages | None:
    vehicle = flight.vehicle
    return None if sent is None else sent.select((sent.sysid == vehicle.sysid) & (sent.compid == vehicle.compid))


def _goes_on(t: Array, known: Array) -> bool:
    """Whether times (N,) hold the last of those that are known (M,), and all of them are among these or around it."""
    last = known[-1]
    near = int(np.searchsorted(t, last - _SAME_S))
    first = min(known[0], last - _AHEAD_S) - _SAME_S
    return bool(near < len(t) and t[near] < last + _SAME_S and t[0] > first and t[-1] < last + _AHEAD_S)
