"""A flight, one boot of one vehicle: its tracks, its messages, and which IMU to integrate.

Also here: a flight without what was measured in some stretches of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from companion.model.aiding import (
    ActuatorTrack,
    AirspeedTrack,
    BarometerTrack,
    BiasTrack,
    CompassTrack,
    ControlTrack,
    EstimatorLane,
    EstimatorReset,
    Event,
    FlowTrack,
    GpsTrack,
    ParameterChange,
    RangeTrack,
    TruthTrack,
)
from companion.model.errors import DataError
from companion.model.tracks import (
    Array,
    AttitudeTrack,
    ImuTrack,
    PositionTrack,
    SensorInUse,
    Series,
    Track,
    by_preference,
    rows,
)
from companion.model.wording import brief, counted

_COVERED = 0.5  # of the time, by what the samples are means over; between them lies what nobody measured


@dataclass(frozen=True, slots=True)
class Vehicle:
    """MAVLink ids, and the names of its heartbeat's enums without their prefix."""

    sysid: int
    compid: int
    autopilot: str  # MAV_AUTOPILOT: ARDUPILOTMEGA, PX4, ... or UNKNOWN without a heartbeat
    type: str  # MAV_TYPE: QUADROTOR, FIXED_WING, SUBMARINE, ... or UNKNOWN
    firmware: str = ""  # as the vehicle states it, "" when it does not

    def __str__(self) -> str:
        return f"{self.sysid}:{self.compid}"


@dataclass(frozen=True, slots=True)
class MessageStats:
    """Arrival of one message type of a flight. Rate and gaps by device time where the message carries it."""

    count: int
    rate_hz: float | None  # messages per second from the first to the last; None for fewer than two times
    longest_gap_s: float | None
    duplicates: int  # copies with the device time and content of another


_SAYS_ARMED = frozenset({"HEARTBEAT", "vehicle_status"})


@dataclass(frozen=True, slots=True)
class StatusText:
    """A STATUSTEXT. Its text is untrusted: escape it before it becomes markup."""

    t: float  # s, boot clock
    severity: int  # MAV_SEVERITY: 0 emergency ... 7 debug
    text: str


@dataclass(frozen=True, slots=True)
class Origin:
    """Where on Earth a flight was, as its autopilot first knew it (WGS-84)."""

    latitude: float  # rad
    longitude: float  # rad
    height: float  # m above mean sea level
    t: float | None = None  # s, boot clock, when the vehicle was there; None: it is the zero of the position track


@dataclass(frozen=True, slots=True)
class SettingNames:
    """The autopilot's own names of the settings that advice mentions."""

    full_rate: str = ""  # in brackets: of the log's rate of the IMU
    imu_stream: str = "SET_MESSAGE_INTERVAL"
    board_trim: str = "of the board's attitude"
    imu_place: str = "the IMU's position"


@dataclass(frozen=True, slots=True)
class Epoch:
    """The zero of the boot clock in UTC."""

    unix_s: float  # s since 1970, UTC
    source: str  # SYSTEM_TIME, GPS, ... of the vehicle; "log stamps": the recording computer's clock


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One boot of one vehicle: its sensors' readings and its autopilot's estimate."""

    __repr__ = brief

    vehicle: Vehicle
    boot: int  # 1 for the vehicle's first boot in the log
    start: float  # s, boot clock, of the first message
    duration: float  # s
    imus: Mapping[str, ImuTrack] = field(default_factory=dict)  # by message name
    attitude: AttitudeTrack | None = None
    position: PositionTrack | None = None
    origin: Origin | None = None
    epoch: Epoch | None = None  # None: the date is unknown
    home: Origin | None = None  # its home position
    series: Mapping[str, Series] = field(default_factory=dict)  # "vibration", "gps", "gps:GPS2_RAW", ...
    events: tuple[Event, ...] = ()  # arming, modes, errors, in order of time
    parameters: Mapping[str, float] = field(default_factory=dict)
    texts: tuple[StatusText, ...] = ()
    messages: Mapping[str, MessageStats] = field(default_factory=dict)
    notes: Sequence[str] = ()  # decisions taken on the way from messages to tracks, in words
    on_board: bool = False  # the vehicle's own log, not what came over a link
    settings: SettingNames = SettingNames()
    declination: float = 0.0  # rad, magnetic, as set on the vehicle or looked up by it; 0: not known
    gps: Sequence[GpsTrack] = ()  # each receiver
    compasses: Sequence[CompassTrack] = ()
    barometers: Sequence[BarometerTrack] = ()
    airspeeds: Sequence[AirspeedTrack] = ()
    ranges: Sequence[RangeTrack] = ()
    flows: Sequence[FlowTrack] = ()
    biases: Sequence[BiasTrack] = ()  # what the estimators believe, each core; that of the one that flew first
    control: ControlTrack | None = None  # the desired attitude
    actuators: ActuatorTrack | None = None
    truth: TruthTrack | None = None  # of a simulator: never an input of the analysis
    imu_in_use: SensorInUse | None = None  # None: unknown
    lanes: Sequence[EstimatorLane] = ()  # every instance of the estimator in the log, also those that did not fly
    lane_in_use: SensorInUse | None = None  # the core that flew; None: unknown
    aiding_in_use: Mapping[str, SensorInUse] = field(default_factory=dict)  # "GPS", "compass", "barometer", "airspeed"
    resets: tuple[EstimatorReset, ...] = ()  # announced, in order of time
    parameter_changes: Sequence[ParameterChange] = ()  # in flight, in order of time

    @property
    def default_imu(self) -> str | None:
        """The IMU message to integrate when the user names none; None when the flight has no usable one.

        RAW_IMU is IMU 0 cut to whole milli-units; where HIGHRES_IMU is the same readings as floats, it is preferred
        when it is of the same IMU throughout. One that the estimator's biases have been taken off is not independent of
        it, and comes last. A message with less than a quarter of the samples of the best is passed over,
        unless its samples are means over intervals that join: nothing costs more accuracy than a low rate.
        """
        order = by_preference()
        if "HIGHRES_IMU" in self.imus:
            floats, raw = self.imus["HIGHRES_IMU"], self.imus.get("RAW_IMU")
            another = raw is not None and (floats.instance != raw.instance or len(floats) < 0.9 * len(raw))
            if floats.bias_removed or another:
                order = [*order[1:], order[0]]
        order = [*(name for name in order if name in self.imus), *self.imus]  # on-board logs: in the order of the log
        samples = {name: len(self.imus[name]) for name in order}
        enough = max(2.0, max(samples.values(), default=0) / 4)
        for name, count in samples.items():
            if count >= enough or (count >= 2 and self.imus[name].covered > _COVERED):
                return name
        return None

    @property
    def how_to_record(self) -> str:
        """How to get more of the IMU from this vehicle than there is, as the beginning of a sentence."""
        if self.on_board:
            return f"Have the IMU logged at its full rate{self.settings.full_rate}"
        return (
            f"Record the IMU at 50-200 Hz, with `companion record LINK` or {self.settings.imu_stream}, or use the "
            "on-board log"
        )

    def with_imu(self, track: ImuTrack) -> Flight:
        """With these readings in place of those of the same message."""
        return replace(self, imus={**self.imus, track.source: track})

    def each_imu(self, fewest: int = 2, *, alone: bool = False) -> tuple[ImuTrack, ...]:
        """One track of every IMU that has samples enough: of several messages that with the highest rate.

        alone: of those that are of one IMU throughout.

        One that the estimator's biases have been taken off counts as a quarter: it steps as these do, and PX4's
        HIGHRES_IMU goes on with another sensor when the selector changes.
        """
        tracks: dict[int, ImuTrack] = {}
        for track in (one for one in self.imus.values() if len(one) >= fewest and not (alone and one.switches)):
            known = tracks.setdefault(track.instance, track)
            tracks[track.instance] = max(known, track, key=lambda one: one.rate_hz / (4 if one.bias_removed else 1))
        return tuple(tracks.values())

    def imu(self, name: str | None = None) -> ImuTrack:
        """The IMU track of message `name`, in capitals or not (default: `default_imu`).

        Raises DataError when the flight has no such message or too few samples to integrate.
        """
        if name is not None:
            name = next((own for own in self.imus if own.upper() == name.upper()), name)
        else:
            name = self.default_imu
        known = ", ".join(f"{n} ({len(track)})" for n, track in self.imus.items()) or "none"
        if name is None:
            raise DataError(f"no IMU message with two samples or more (found: {known}). {self.how_to_record}.")
        if name not in self.imus:
            raise DataError(
                f"vehicle {self.vehicle}, boot {self.boot}: no usable {name} (IMU messages and samples found: {known})."
            )
        if len(self.imus[name]) < 2:
            raise DataError(
                f"{name} has {counted(len(self.imus[name]), 'sample')}, and an integration needs two or more. "
                "Record longer, or choose another IMU with --imu."
            )
        return self.imus[name]

    def armed(self, begin: Array, end: Array) -> npt.NDArray[np.bool_] | None:
        """(N,) whether the vehicle was armed in some of each span, s, boot clock; None where that is not known.

        Where nothing changes the first message that says it would have told of an armed vehicle.
        """
        changes = [(e.t, e.kind == "armed") for e in self.events if e.kind in {"armed", "disarmed"}]
        if not changes:
            return None if _SAYS_ARMED.isdisjoint(self.messages) else np.zeros(len(begin), np.bool_)
        t, state = (np.array(column) for column in zip(*changes, strict=True))
        before = np.concatenate([[not state[0]], state])  # the first event is a change
        at_start, at_end = (before[np.searchsorted(t, when, side="right")] for when in (begin, end))
        return np.asarray(at_start | at_end)

    def require_attitude(self) -> AttitudeTrack:
        """The attitude track. Raises DataError when the flight has none, or fewer than two samples of it."""
        if self.attitude is not None and len(self.attitude) > 1:
            return self.attitude
        if self.attitude is not None or self.messages.keys() & {"ATTITUDE", "ATTITUDE_QUATERNION", "XKQ", "ATT"}:
            raise DataError(
                "fewer than two usable samples of the attitude. Record longer"
                + ("." if self.on_board else ", or use the on-board log.")
            )
        raise DataError(
            f"no attitude to compare with (messages found: {', '.join(sorted(self.messages)) or 'none'}). "
            + (
                "Have the estimator's attitude logged."
                if self.on_board
                else "Ask the vehicle for ATTITUDE (stream EXTRA1), or use its on-board log."
            )
        )


class Change(Protocol):
    """A function of a track of any kind to one of the same kind."""

    def __call__(self, track: Track, /) -> Track: ...


def with_tracks(flight: Flight, change: Change) -> Flight:
    """The flight with every track of its sensors and its estimate changed."""
    kinds = ("gps", "compasses", "barometers", "airspeeds", "ranges", "flows")
    aiding: dict[str, Any] = {kind: tuple(map(change, getattr(flight, kind))) for kind in kinds}
    return replace(
        flight,
        imus={name: change(track) for name, track in flight.imus.items()},
        attitude=None if flight.attitude is None else change(flight.attitude),
        position=None if flight.position is None else change(flight.position),
        **aiding,
    )


def without(flight: Flight, spans: Sequence[tuple[float, float]]) -> Flight:
    """The flight without the samples of sensors and estimate within spans (s, boot clock); messages and events stay."""
    if not spans:
        return flight

    def outside(track: Track) -> Track:
        kept = np.ones(len(track), np.bool_)
        for begin, end in spans:
            kept &= (track.t < begin) | (track.t >= end)
        return rows(track, kept)

    return with_tracks(flight, outside)
