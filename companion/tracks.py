"""The nouns of companion: what a flight is made of, as frozen dataclasses of arrays.

Conventions, everywhere (docs/conventions.md):

- time `t` in seconds of the vehicle's boot clock, time first in every array, float64;
- body frame FRD (forward, right, down), world frame NED (north, east, down) about the flight's own origin;
- `q_ned_frd`: Hamilton quaternion `[w, x, y, z]` that rotates FRD vectors into NED;
- specific force is what an accelerometer says: `(0, 0, -g)` at rest and level; angles in radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from companion.errors import DataError
from companion.series import Event, Series

Array = npt.NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""m/s², the value behind MAVLink's mG and ArduPilot's and PX4's estimators."""


def _check(name: str, t: Array, **columns: tuple[Array, int]) -> None:
    """Hold the contract of a track: shapes agree, everything finite, time strictly increasing."""
    if t.ndim != 1:
        raise ValueError(f"{name}.t must have shape (N,), got {t.shape}")
    for column, (values, width) in columns.items():
        if values.shape != (len(t), width):
            raise ValueError(f"{name}.{column} must have shape ({len(t)}, {width}), got {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError(f"{name}.{column} holds non-finite values")
    if not np.isfinite(t).all():
        raise ValueError(f"{name}.t holds non-finite values")
    if len(t) > 1 and not (np.diff(t) > 0).all():
        first = int(np.argmin(np.diff(t) > 0))
        raise ValueError(f"{name}.t must increase strictly; sample {first + 1} does not follow sample {first}")


@dataclass(frozen=True, slots=True, eq=False)
class ImuTrack:
    """Samples of one IMU in the body frame that the autopilot's attitude speaks of.

    Raises ValueError for shapes that do not match, non-finite samples or times that do not increase.
    """

    t: Array  # (N,) s, strictly increasing
    gyro: Array  # (N, 3) angular rate, FRD, rad/s
    accel: Array  # (N, 3) specific force, FRD, m/s²
    source: str = ""  # the message it came from: RAW_IMU, SCALED_IMU2, ...
    gyro_step: float = 0.0  # rad/s, quantisation step of the readings; 0 for floats
    accel_step: float = 0.0  # m/s², the same for specific force
    instance: int = 0  # which of the vehicle's IMUs: RAW_IMU is always 0, SCALED_IMU2 is 1, ...
    t_step: float = 0.0  # s, resolution of the message's clock; 0 where it is far finer than an interval

    def __post_init__(self) -> None:
        _check("ImuTrack", self.t, gyro=(self.gyro, 3), accel=(self.accel, 3))

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, index: slice) -> ImuTrack:
        """The same track, cut to a slice of its samples."""
        return replace(self, t=self.t[index], gyro=self.gyro[index], accel=self.accel[index])

    @property
    def rate_hz(self) -> float:
        """1 / median sample interval; 0 for fewer than two samples."""
        return float(1.0 / np.median(np.diff(self.t))) if len(self) > 1 else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTrack:
    """The autopilot's own attitude. Raises ValueError as ImuTrack does."""

    t: Array  # (N,) s, strictly increasing
    q_ned_frd: Array  # (N, 4) wxyz, unit length, sign continuous along the track
    rates: Array  # (N, 3) the autopilot's bias-corrected body rates, FRD, rad/s
    source: str = ""

    def __post_init__(self) -> None:
        _check("AttitudeTrack", self.t, q_ned_frd=(self.q_ned_frd, 4), rates=(self.rates, 3))

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True, eq=False)
class PositionTrack:
    """The autopilot's own position and velocity. Raises ValueError as ImuTrack does."""

    t: Array  # (N,) s, strictly increasing
    position: Array  # (N, 3) NED, m, about the flight's origin
    velocity: Array  # (N, 3) NED, m/s
    source: str = ""

    def __post_init__(self) -> None:
        _check("PositionTrack", self.t, position=(self.position, 3), velocity=(self.velocity, 3))

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, slots=True, eq=False)
class NavState:
    """Where a strapdown integration stands at one instant: the start of a run or the end of a chunk."""

    t: float  # s
    q_ned_frd: Array  # (4,) wxyz
    velocity: Array  # (3,) NED, m/s
    position: Array  # (3,) NED, m


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """What the integration says, at the times of the IMU samples."""

    t: Array  # (N,) s
    q_ned_frd: Array  # (N, 4) wxyz, unit length, sign continuous
    velocity: Array  # (N, 3) NED, m/s
    position: Array  # (N, 3) NED, m
    notes: tuple[str, ...] = ()  # what was done differently from what was asked, and why

    def __len__(self) -> int:
        return len(self.t)

    @property
    def end(self) -> NavState:
        """The state at the last sample: where the next chunk continues."""
        return NavState(float(self.t[-1]), self.q_ned_frd[-1], self.velocity[-1], self.position[-1])


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Who flew: MAVLink ids, and what its heartbeats say (names without the enum's prefix)."""

    sysid: int
    compid: int
    autopilot: str  # MAV_AUTOPILOT: ARDUPILOTMEGA, PX4, ... or UNKNOWN without a heartbeat
    type: str  # MAV_TYPE: QUADROTOR, FIXED_WING, SUBMARINE, ... or UNKNOWN
    firmware: str = ""  # as the vehicle states it, "" when it does not

    def __str__(self) -> str:
        return f"{self.sysid}:{self.compid}"


@dataclass(frozen=True, slots=True)
class MessageStats:
    """How one message type of a flight arrived. Rate and gaps by device time where the message carries it."""

    count: int
    rate_hz: float | None  # 1 / median period; None for fewer than two messages
    longest_gap_s: float | None
    duplicates: int  # copies with the device time and content of another


@dataclass(frozen=True, slots=True)
class StatusText:
    """What the vehicle said in words. The text is untrusted: escape it before it becomes markup."""

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
class Epoch:
    """When the boot clock was zero, in the world's time."""

    unix_s: float  # s since 1970, UTC
    source: str  # SYSTEM_TIME, GPS, ...: the vehicle's own word; "log stamps": the recording computer's


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One boot of one vehicle: what its IMUs measured and what its autopilot made of it."""

    vehicle: Vehicle
    boot: int  # 1 for the vehicle's first boot in the log
    start: float  # s, boot clock, of the first message
    duration: float  # s
    imus: Mapping[str, ImuTrack] = field(default_factory=dict)  # by message name
    attitude: AttitudeTrack | None = None
    position: PositionTrack | None = None
    origin: Origin | None = None
    epoch: Epoch | None = None  # None where the log does not tell the date
    home: Origin | None = None  # where it says that it returns to
    series: Mapping[str, Series] = field(default_factory=dict)  # "vibration", "gps", "gps:GPS2_RAW", ...
    events: tuple[Event, ...] = ()  # arming, modes, errors, in order of time
    parameters: Mapping[str, float] = field(default_factory=dict)
    texts: tuple[StatusText, ...] = ()
    messages: Mapping[str, MessageStats] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # decisions taken on the way from messages to tracks, in words
    on_board: bool = False  # the vehicle's own log, not what came over a link

    @property
    def default_imu(self) -> str | None:
        """The IMU message to integrate when the user names none; None when the flight has no usable one.

        ArduPilot's RAW_IMU is IMU 0 cut to whole milli-units; HIGHRES_IMU is the same readings as floats, so it
        is preferred when it speaks of the same IMU throughout. PX4 subtracts its EKF's biases from HIGHRES_IMU, which
        makes it a witness in its own case: there SCALED_IMU is the independent one. A message with less than a quarter
        of the samples of the best is passed over: nothing costs more accuracy than a low rate.
        """
        order = ["HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"]
        if self.vehicle.autopilot == "PX4":
            order = ["SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "RAW_IMU", "HIGHRES_IMU"]
        elif "HIGHRES_IMU" in self.imus and "RAW_IMU" in self.imus:
            floats, integers = self.imus["HIGHRES_IMU"], self.imus["RAW_IMU"]
            if floats.instance != integers.instance or len(floats) < 0.9 * len(integers):
                order = [*order[1:], order[0]]
        order += [name for name in self.imus if name not in order]  # on-board logs: in the order of the log
        samples = {name: len(self.imus[name]) for name in order if name in self.imus}
        enough = max(2.0, max(samples.values(), default=0) / 4)
        return next((name for name, count in samples.items() if count >= enough), None)

    @property
    def how_to_record(self) -> str:
        """How to get more of the IMU from this vehicle than there is, as the beginning of a sentence."""
        px4 = self.vehicle.autopilot == "PX4"
        if self.on_board:
            how = "full rate (SDLOG_PROFILE: high rate)" if px4 else "full rate (LOG_BITMASK: fast or raw IMU)"
            return f"Have the IMU logged at its {how}"
        how = "SCALED_IMU on an onboard link: MAV_x_MODE 2" if px4 else "SRx_RAW_SENS, SET_MESSAGE_INTERVAL"
        return f"Record the IMU at 50-200 Hz ({how}), or use the on-board log"

    def imu(self, name: str | None = None) -> ImuTrack:
        """The IMU track of message `name`, in capitals or not (default: `default_imu`).

        Raises DataError when the flight has no such message or too few samples to integrate.
        """
        if name is not None:
            name = next((own for own in self.imus if own.upper() == name.upper()), name)
        else:
            name = self.default_imu
        found = ", ".join(f"{n} ({len(track)})" for n, track in self.imus.items()) or "none"
        if name is None:
            raise DataError(f"no IMU message with two samples or more (found: {found}). {self.how_to_record}.")
        if name not in self.imus:
            raise DataError(
                f"vehicle {self.vehicle}, boot {self.boot}: no usable {name} (IMU messages and samples found: {found})."
            )
        if len(self.imus[name]) < 2:
            raise DataError(
                f"{name} has {len(self.imus[name])} sample, and an integration needs two or more. "
                "Record longer, or choose another IMU with --imu."
            )
        return self.imus[name]

    def require_attitude(self) -> AttitudeTrack:
        """The attitude track. Raises DataError when the flight has none."""
        if self.attitude is None and self.messages.keys() & {"ATTITUDE", "ATTITUDE_QUATERNION", "XKQ", "ATT"}:
            raise DataError(
                "fewer than two usable samples of the attitude. Record longer"
                + ("." if self.on_board else ", or use the on-board log.")
            )
        if self.attitude is None:
            raise DataError(
                f"no attitude to compare with (messages found: {', '.join(sorted(self.messages)) or 'none'}). "
                + (
                    "Have the estimator's attitude logged."
                    if self.on_board
                    else "Ask the vehicle for ATTITUDE (stream EXTRA1), or use its on-board log."
                )
            )
        return self.attitude
