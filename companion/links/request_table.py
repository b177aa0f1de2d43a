"""Which messages are requested of a vehicle, at which rate, how far that has come, and what a slow link carries of it.

A radio behind UDP does not report its bandwidth: whether the link carries what was agreed shows in the rates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import ceil, inf
from typing import Literal

from companion.links.requests import Target
from companion.mavlink import Dialect
from companion.model import IMU_MESSAGES

Desired = dict[str, float]
"""Message name → Hz, the most important first."""


@dataclass(frozen=True, slots=True)
class Row:
    """One message that is requested."""

    name: str
    hz: float | Literal["imu", "half the imu", "attitude", "position"]
    least_hz: float  # that a slow line leaves of it; 0: it is left out
    autopilots: tuple[str, ...] = ()  # that have it; (): all
    optional: bool = False  # many vehicles have no such sensor: its absence is said once, in one sentence with others
    stream: int = 0  # MAV_DATA_STREAM of ArduPilot that carries it: 1 RAW_SENSORS, 2 EXTENDED_STATUS, 6 POSITION, ...


_ARDUPILOT, _PX4, _OTHER = "ARDUPILOTMEGA", "PX4", ""

_ROWS = (
    # PX4 has no RAW_IMU, and HIGHRES_IMU there lacks the EKF's biases: SCALED_IMU is the independent sensor.
    Row("RAW_IMU", "imu", 10.0, (_ARDUPILOT, _OTHER), stream=1),
    Row("SCALED_IMU", "imu", 10.0, (_PX4, _OTHER)),
    Row("ATTITUDE", "attitude", 10.0, stream=10),
    Row("LOCAL_POSITION_NED", "position", 4.0, stream=6),
    Row("GPS_RAW_INT", 5.0, 2.0, optional=True, stream=2),
    Row("EKF_STATUS_REPORT", 2.0, 1.0, (_ARDUPILOT,), optional=True, stream=12),
    Row("ESTIMATOR_STATUS", 2.0, 1.0, (_PX4,), optional=True),
    Row("SCALED_PRESSURE", 10.0, 2.0, optional=True, stream=1),
    Row("EXTENDED_SYS_STATE", 1.0, 1.0, optional=True),
    Row("SYS_STATUS", 1.0, 0.0, optional=True, stream=2),  # the battery
    Row("SCALED_IMU2", "half the imu", 5.0, optional=True, stream=1),
    Row("VIBRATION", 2.0, 1.0, optional=True, stream=12),
    Row("GLOBAL_POSITION_INT", 5.0, 1.0, stream=6),
    Row("ODOMETRY", 5.0, 0.0, (_PX4,), optional=True),  # 245 bytes: resets and variances
    Row("GPS2_RAW", 5.0, 0.0, optional=True, stream=2),
    Row("SCALED_IMU3", "half the imu", 0.0, optional=True, stream=1),
    Row("ATTITUDE_TARGET", 5.0, 0.0, optional=True),
    # ArduPilot's HIGHRES_IMU are floats, but perhaps of another IMU than 0, PX4's of the one that its EKF selected:
    # with the first message beside it that shows. The same sensor twice is what a slow line goes without first.
    Row("HIGHRES_IMU", "imu", 0.0),
)


def with_every_imu(rows: Sequence[Row], imu_messages: Iterable[str]) -> tuple[Row, ...]:
    """The rows, and one for each IMU message without: one more IMU, requested as those beside the first are."""
    named = {row.name for row in rows}
    return (*rows, *(Row(name, "half the imu", 0.0, optional=True) for name in imu_messages if name not in named))


TABLE = with_every_imu(_ROWS, IMU_MESSAGES)
"""What the analysis lives on, the most important first. A slow line takes from the last row first.

Few different rates: ArduPilot keeps ten intervals for a link, and takes the nearest for a further one.
"""

OPTIONAL = frozenset(row.name for row in TABLE if row.optional)
"""Messages that many vehicles have no sensor for."""

STREAMS = {row.name: row.stream for row in TABLE if row.stream}
"""Message → MAV_DATA_STREAM."""

_FRAME_BYTES = 12  # MAVLink 2: header and CRC
SHARE = 0.7
"""Of a line's bytes that we may fill: others use it too."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What a session asks for."""

    vehicle: str | None = None  # SYSID or SYSID:COMPID; None: the first that sends an IMU on request; "all": each
    imu_hz: float = 100.0
    attitude_hz: float = 50.0
    position_hz: float = 20.0

    def names(self, target: Target) -> bool:
        """Whether the user has named this vehicle."""
        return self.vehicle in (str(target.sysid), str(target))


def desired_from(autopilot: str, choice: Choice = Choice()) -> Desired:
    """What to ask of an autopilot (MAV_AUTOPILOT without prefix): what the analysis uses of what it may have."""
    rates = {
        "imu": choice.imu_hz, "half the imu": max(choice.imu_hz / 2, 1.0),
        "attitude": choice.attitude_hz, "position": choice.position_hz,
    }  # fmt: skip
    known = autopilot if autopilot in (_ARDUPILOT, _PX4) else _OTHER
    rows = (row for row in TABLE if not row.autopilots or known in row.autopilots)
    return {row.name: rates[row.hz] if isinstance(row.hz, str) else row.hz for row in rows}


def load(desired: Mapping[str, float], dialect: Dialect) -> float:
    """Bytes per second of the desired messages, as MAVLink 2."""
    return sum(hz * (dialect.by_name[name].max_length + _FRAME_BYTES) for name, hz in desired.items())


def fit(
    desired: Mapping[str, float],
    dialect: Dialect,
    bytes_per_second: float | None,
    advice: str = "Use a faster baud rate.",
) -> tuple[Desired, str]:
    """What of it a line carries, and a sentence when that is less.

    From the last row of the table to the first each message is lowered as far as is needed, to its least rate or out
    of the list; so the IMU is the last to suffer. Where even the least rates are too much, all are lowered alike.
    bytes_per_second: of the line; None when it has no limit that we know. What the dialect lacks is not requested.
    """
    desired = {name: hz for name, hz in desired.items() if name in dialect.by_name}
    needed = load(desired, dialect)
    if bytes_per_second is None or needed <= SHARE * bytes_per_second:
        return desired, ""
    left, over = dict(desired), needed - SHARE * bytes_per_second
    for row in reversed(TABLE):
        if row.name in left and over > 0:
            hz, size = left[row.name], load({row.name: 1.0}, dialect)
            lowered = max(hz - over / size, min(row.least_hz, hz))
            left[row.name] = lowered if lowered >= 1.0 else 0.0
            over -= (hz - left[row.name]) * size
    left = {name: hz for name, hz in left.items() if hz}
    if over > 1e-6:
        share = SHARE * bytes_per_second / load(left, dialect)
        left = {name: hz * share for name, hz in left.items()}
    return left, (
        f"the line carries {bytes_per_second:,.0f} bytes/s and the wanted messages need {needed:,.0f}: "
        f"{_changes(desired, left)}. {advice}"
    )


def _changes(desired: Mapping[str, float], left: Mapping[str, float]) -> str:
    out = [name for name in desired if name not in left]
    slower = [f"{name} {left[name]:.3g} of {hz:g} Hz" for name, hz in desired.items() if left.get(name, hz) < hz]
    parts = [f"left out: {', '.join(out)}"] if out else []
    return "; ".join(parts + ([f"lowered: {', '.join(slower)}"] if slower else []))


_GATHER_S = 20.0  # sentences of one kind are gathered so long: a vehicle that refuses one message refuses several
_MORE_S = 2.0  # ... and at least so long after the newest


class RequestState(Enum):
    """How far a request has come."""

    FINDING = "asking for the present interval"
    ASKING = "asking for ours"
    WATCHING = "agreed"
    GIVEN_UP = "given up"


REFUSES = "the vehicle refuses it"
ABSENT = "the vehicle does not send {}: it has no such sensor, or its firmware no such message"
SIGNS = "the vehicle signs its messages and does not answer unsigned requests: give its key with --signing-key-file"

WITHOUT = {"LOCAL_POSITION_NED": "the autopilot's estimate has no position yet (GPS?)"}
"""Why a message does not come at all, where that is no lack of a sensor. When it comes, that is said."""


@dataclass(slots=True)
class StreamRequest:
    """One message and its desired rate."""

    name: str
    message_id: int
    desired_hz: float
    requested_hz: float  # lower than desired when the vehicle denied that
    received_hz: float = 0.0  # over the last 5 s
    found_us: int | None = None  # the interval before our request, as MESSAGE_INTERVAL reports it; None: not known
    found_hz: float = 0.0  # what arrived before our request, where the vehicle reported no interval
    ours: bool = False  # an interval of ours has been requested, and perhaps taken
    asked_us: set[int] = field(default_factory=set)  # each of them: of those that are lost none is known to be taken
    requested_s: float = -inf  # s, when that was last
    state: RequestState = RequestState.FINDING
    by_stream: bool = False  # requested with REQUEST_DATA_STREAM
    attempts: int = 0  # of the present request
    retries: int = 0  # after it was turned down
    due: float = 0.0  # s, when to ask (again)
    count: int = 0  # arrived in this window
    window: float | None = None  # s, when it began

    @property
    def arrives(self) -> bool:
        """Whether it has come lately."""
        return bool(self.count or self.received_hz)

    def arriving_hz(self, now: float) -> float:
        """How often it has come lately."""
        counted = self.count / (now - self.window) if self.window is not None and now > self.window else 0.0
        return max(self.received_hz, counted)

    def move(self, state: RequestState, due: float) -> None:
        """Begin a state: nothing has been tried or counted in it. due: s, when to ask."""
        self.state, self.attempts, self.due, self.window = state, 0, due, None


class Gathered:
    """Messages that something has happened to, gathered into one sentence for each reason."""

    def __init__(self) -> None:
        self._why: dict[str, list[str]] = {}
        self._since: float | None = None  # s, of the first
        self._newest = 0.0  # s

    def add(self, name: str, why: str, now: float) -> None:
        """why: with "{}" where the names stand."""
        self._why.setdefault(why, []).append(name)
        self._since, self._newest = now if self._since is None else self._since, now

    def sentences(self, now: float, *, complete: bool) -> list[str]:
        """What there is to say now. complete: every request is agreed or given up."""
        complete = complete and now - self._newest > _MORE_S
        if self._since is None or not (complete or now - self._since > _GATHER_S):
            return []
        sentences = [why.format(", ".join(names)) for why, names in self._why.items()]
        self._why, self._since = {}, None
        return sentences


def slower(hz: float) -> float:
    """The next rate to try: ArduPilot knows whole milliseconds only, and the fastest of them depends on its loop."""
    interval = int(1000 / hz)
    return 1000 / max(interval + 1, ceil(1.25 * interval))


_LOOK_S = 5.0  # over which rates are measured
_ENOUGH = 0.6  # of the bytes agreed: less is a link that does not carry them
_SHORT = 0.8  # of its own rate: a message of which less comes
_MOST = 0.75  # of the bytes are of messages that are short at once: one that another program overrides is short alone
_LOST = 0.1  # share of the frames that a link loses which is too full
_LOOKS = 2  # in a row
_FITS = 0.9  # of what arrived


class ThinLink:
    """Looks at what arrives; says what would fit where too little does.

    scales: whether the autopilot itself sends less of everything where a link is too slow (PX4), so that nothing is
    lost. Of ArduPilot that is a download of parameters, or another program's stream rates.
    """

    def __init__(self, dialect: Dialect, *, scales: bool) -> None:
        self._scales = scales
        self._dialect = dialect
        self._due: float | None = None  # s
        self._looks = 0  # in a row at which too little has come

    def start_again(self) -> None:
        """Nothing is known any more: what is agreed begins anew."""
        self._due, self._looks = None, 0

    def fitting(
        self, stream_requests: Sequence[StreamRequest], lost: float, now: float
    ) -> tuple[dict[str, float], str]:
        """Message → Hz that would fit, and a sentence; empty where nothing is to be lowered.

        lost: the share of the vehicle's frames that is missing by their sequence.
        """
        if self._due is None or now < self._due:
            self._due = self._due or now + 2 * _LOOK_S
            return {}, ""
        self._due = now + _LOOK_S
        coming = [one for one in stream_requests if one.received_hz]
        agreed = {one.name: one.requested_hz for one in coming}
        arrives = load({one.name: min(one.received_hz, one.requested_hz) for one in coming}, self._dialect)
        short = {one.name: one.requested_hz for one in coming if one.received_hz < _SHORT * one.requested_hz}
        needed, full = load(agreed, self._dialect), lost > _LOST or self._scales
        thin = full and arrives < _ENOUGH * needed and load(short, self._dialect) >= _MOST * needed
        self._looks = self._looks + 1 if thin else 0
        if self._looks < _LOOKS:
            return {}, ""
        self.start_again()
        carries = _FITS * arrives / SHARE
        left, words = fit(agreed, self._dialect, carries, "Whoever shares the link has the rest.")
        return {name: left.get(name, min(hz, 1.0)) for name, hz in agreed.items()}, words
