"""A simulated MAVLink vehicle: bytes in, packets out, at times that the caller or the clock sets.

The fields of its messages at the steps of its loop, in wire units; its message intervals, and the rules of ArduPilot
and PX4 for requests.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from companion.links import Port
from companion.mavlink import Decoder, MessageLayout, Packer, Value, load_dialect, split_messages
from companion.model import STANDARD_GRAVITY, Array, InputError, geodetic_from_ned
from companion.simulate.true_flight import GPS_SIGMA, HOME, LOOP_US, Channel, Faults, Flown, pressure
from companion.strapdown import quaternion

_Steps = npt.NDArray[np.int64]
_Fields = Mapping[str, npt.NDArray[Any] | float]

_ALIGNED = 0b11_0011_1111  # ESTIMATOR_STATUS_FLAGS: attitude, velocity, position and height are known
_RATIO = 0.05  # of an innovation to what it may be, in an estimator that is well
_LOCAL_NED, _ON_GROUND, _IN_AIR = 1, 1, 2  # MAV_FRAME, MAV_LANDED_STATE
_ALOFT_M = 0.1
_COVARIANCE = 21  # elements; the first is NaN where it is not known


def _odometry(flown: Flown, index: _Steps, _: _Steps) -> _Fields:
    """As PX4's: both frames are local NED."""
    unknown = np.full((len(index), _COVARIANCE), np.nan)
    names = ("x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed")
    columns = np.hstack([flown.position[index], flown.velocity[index], flown.rates[index]]).T
    known = dict(zip(names, columns, strict=True)) | {"q": flown.q_ned_frd[index]}
    frames = {"frame_id": _LOCAL_NED, "child_frame_id": _LOCAL_NED}
    return {**known, **frames, "pose_covariance": unknown, "velocity_covariance": unknown}


_MG, _MRAD = STANDARD_GRAVITY * 1e-3, 1e-3
_GAUSS = 1e-4  # tesla
_FIX_3D, _SATELLITES, _UNKNOWN = 3, 14, 65535
_HPA, _MILD = 100.0, 2500  # Pa; cdegC
_IMU = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
_COMPASS = ("xmag", "ymag", "zmag")
_ANGLES, _RATES = ("roll", "pitch", "yaw"), ("rollspeed", "pitchspeed", "yawspeed")
_QUATERNION = ("q1", "q2", "q3", "q4")


def _payloads(layout: MessageLayout, flown: Flown, index: _Steps, boot_us: _Steps) -> list[bytes]:
    """The payloads of one message at loop steps `index` (N,), `boot_us` (N,) µs after boot: as on the wire, untrimmed.

    Integers are cut towards zero, as ArduPilot's C casts do (GCS_Common.cpp, send_raw_imu).
    """
    rows = np.zeros(len(index), layout.dtype)
    stamps = {"time_usec": boot_us, "time_boot_ms": boot_us // 1000}
    fields = {name: stamp for name, stamp in stamps.items() if name in layout.fields}
    for field, values in (fields | dict(_FIELDS[layout.name](flown, index, boot_us))).items():
        rows[field] = values
    packed, size = rows.tobytes(), layout.max_length
    return [packed[begin : begin + size] for begin in range(0, len(packed), size)]


def _global(flown: Flown, index: _Steps, _: _Steps) -> _Fields:
    position = flown.position[index]
    place = _geodetic(position) * [1e7, 1e7, 1e3]
    names = ("lat", "lon", "alt", "relative_alt", "vx", "vy", "vz")
    columns = _columns(names, place, -position[:, 2:] * 1e3, flown.velocity[index] * 100)
    return {**columns, "hdg": _UNKNOWN}  # not known


def _fix(flown: Flown, index: _Steps, boot_us: _Steps) -> _Fields:
    """GPS_RAW_INT: the newest fix, with the time at which it came. Without the extensions that it does not know."""
    seen, t = flown.aiding, flown.truth.t[index]
    newest = np.maximum(np.searchsorted(seen.fixed, t + 1e-6, side="right") - 1, 0)
    place, (north, east, _) = _geodetic(seen.place[newest]) * [1e7, 1e7, 1e3], seen.velocity[newest].T
    horizontal, vertical, speed = (round(1e3 * sigma) for sigma in GPS_SIGMA)
    return {
        "time_usec": np.maximum(boot_us - np.rint((t - seen.fixed[newest]) * 1e6).astype(np.int64), 0),
        **_columns(("lat", "lon", "alt"), place),
        "vel": np.hypot(north, east) * 100,
        "cog": np.degrees(np.arctan2(east, north)) % 360.0 * 100,
        "fix_type": _FIX_3D, "satellites_visible": _SATELLITES, "eph": 80, "epv": 120,
        "h_acc": horizontal, "v_acc": vertical, "vel_acc": speed, "hdg_acc": 0, "yaw": 0,
    }  # fmt: skip


def _highres(flown: Flown, index: _Steps, _: _Steps) -> _Fields:
    readings = flown.imu.accel[index], flown.imu.gyro[index], flown.aiding.fields[0][index] / _GAUSS
    return {**_columns((*_IMU, *_COMPASS), *readings), "fields_updated": 0x1FF}


def _milli(flown: Flown, index: _Steps, _: _Steps, *, second: bool = False) -> _Fields:
    imu, field = flown.second if second else flown.imu, flown.aiding.fields[second]
    readings = np.hstack([imu.accel[index] / _MG, imu.gyro[index] / _MRAD, field[index] / _GAUSS * 1e3])
    return _columns((*_IMU, *_COMPASS), np.clip(np.trunc(readings), -32768, 32767))


def _truth(flown: Flown, index: _Steps, _: _Steps) -> _Fields:
    """SIM_STATE; like ArduPilot's without a time of its own, and with degE7 in lat_int and lon_int."""
    truth = flown.truth
    q, place = truth.q_ned_frd[index], _geodetic(truth.position[index])
    names = (*_QUATERNION, *_ANGLES, "lat", "lon", "alt", "lat_int", "lon_int", *_IMU, "vn", "ve", "vd")
    sensed = truth.accel[index], truth.gyro[index], truth.velocity[index]
    return _columns(names, q, quaternion.to_euler(q), place, place[:, :2] * 1e7, *sensed)


def _columns(names: tuple[str, ...], *values: Array) -> _Fields:
    """Field names → columns of blocks (N, ...) that lie side by side."""
    return dict(zip(names, np.hstack(values).T, strict=True))


def _geodetic(position: Array) -> Array:
    """NED (N, 3) in m about home → latitude and longitude in °, altitude in m."""
    place = geodetic_from_ned(position, HOME)
    return np.column_stack([np.degrees(place[:, :2]), place[:, 2]])


def _ratios(*names: str) -> Callable[[Flown, _Steps, _Steps], _Fields]:
    return lambda _flown, _index, _: dict.fromkeys(names, _RATIO) | {"flags": _ALIGNED}


_FIELDS: Mapping[str, Callable[[Flown, _Steps, _Steps], _Fields]] = {
    "RAW_IMU": _milli,
    "SCALED_IMU": _milli,
    "SCALED_IMU2": partial(_milli, second=True),
    "HIGHRES_IMU": _highres,
    "ATTITUDE": lambda f, i, _: _columns((*_ANGLES, *_RATES), quaternion.to_euler(f.q_ned_frd[i]), f.rates[i]),
    "ATTITUDE_QUATERNION": lambda f, i, _: _columns((*_QUATERNION, *_RATES), f.q_ned_frd[i], f.rates[i]),
    "LOCAL_POSITION_NED": lambda f, i, _: _columns(("x", "y", "z", "vx", "vy", "vz"), f.position[i], f.velocity[i]),
    "GLOBAL_POSITION_INT": _global,
    "SYS_STATUS": lambda *_: {"load": 250, "voltage_battery": 12_600, "battery_remaining": 80},
    "SIM_STATE": _truth,
    "GPS_RAW_INT": _fix,
    "SCALED_PRESSURE": lambda f, i, _: {"press_abs": pressure(f.aiding.height[i]) / _HPA, "temperature": _MILD},
    "VIBRATION": lambda *_: dict.fromkeys(("vibration_x", "vibration_y", "vibration_z"), 1),
    "EKF_STATUS_REPORT": _ratios("velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance"),
    "ESTIMATOR_STATUS": _ratios("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"),
    "EXTENDED_SYS_STATE": lambda f, i, _: {
        "landed_state": np.where(-f.truth.position[i, 2] > _ALOFT_M, _IN_AIR, _ON_GROUND)
    },
    "ODOMETRY": _odometry,
}
"""Message → its fields but the stamp, at loop steps (N,), at times (N,) µs after boot."""


Autopilot = Literal["ardupilot", "px4"]

_ACCEPTED, _DENIED = 0, 2  # MAV_RESULT

_DISTINCT = 10
"""Distinct intervals that ArduPilot keeps for a link; a further one silently becomes the nearest of them."""


@dataclass(slots=True)
class _Stream:
    interval_us: int  # 0: not sent
    due_us: int


class _Intervals:
    """Which message is due when.

    default: message → interval in µs at boot, 0 for one that is not sent. unlimited: those of them that PX4 sends at
    every update of their source, which comes so often.
    """

    def __init__(
        self, default: Mapping[str, int], autopilot: Autopilot, *, unlimited: Collection[str] = frozenset()
    ) -> None:
        self._default = dict(default)
        self._unlimited = set(unlimited)
        self._autopilot = autopilot
        self._streams = {name: _Stream(interval, 0) for name, interval in default.items()}

    def get(self, name: str) -> int:
        """The interval of MESSAGE_INTERVAL: µs, -1 for one that is not sent, 0 for one that is not known.

        PX4: 0 for one that is not sent, -1 for one without a limit (mavlink_receiver.cpp, get_message_interval).
        """
        if name not in self._streams:
            return 0
        interval = self._streams[name].interval_us
        if self._autopilot == "px4":
            return -1 if name in self._unlimited and interval == self._default[name] else interval
        return interval or -1

    def set(self, name: str, requested_us: float, now_us: int) -> int:
        """SET_MESSAGE_INTERVAL: ACCEPTED or DENIED (GCS_Common.cpp, set_message_interval)."""
        if name not in self._streams:
            return _DENIED
        interval = int(requested_us)
        if interval == 0:
            interval = self._default[name]
        elif interval < 0:
            interval = 0
        elif self._autopilot == "ardupilot":
            milliseconds = interval // 1000  # requested 150 Hz, got 166.7
            if milliseconds < LOOP_US // 800:  # 333 Hz is the fastest at a 400 Hz loop
                return _DENIED
            interval = self._nearest(name, milliseconds * 1000)
        self._streams[name] = _Stream(interval, now_us)
        return _ACCEPTED

    @property
    def next_us(self) -> float:
        """When the next message is due; infinite when none is sent."""
        return min((stream.due_us for stream in self._streams.values() if stream.interval_us), default=math.inf)

    def due(self, now_us: int) -> list[str]:
        """The messages to send now."""
        due = []
        for name, stream in self._streams.items():
            if stream.interval_us and stream.due_us <= now_us:
                due.append(name)
                stream.due_us += stream.interval_us
                if stream.due_us < now_us - stream.interval_us:  # too far behind to make good
                    stream.due_us = now_us + stream.interval_us
        return due

    def schedule(self, name: str, now_us: int, count: int) -> npt.NDArray[np.int64]:
        """When a message that is sent now will be sent the next times, if nobody sets its interval: µs, (count,)."""
        stream = self._streams[name]
        due = stream.due_us + stream.interval_us * np.arange(count - 1)
        return np.concatenate(([now_us], -(-due // LOOP_US) * LOOP_US))

    def _nearest(self, name: str, interval: int) -> int:
        used = {stream.interval_us for other, stream in self._streams.items() if other != name} - {0}
        if interval in used or len(used) < _DISTINCT:
            return interval
        return min(used, key=lambda known: abs(known - interval))


_GET_INTERVAL, _SET_INTERVAL, _REQUEST_MESSAGE = 510, 511, 512  # MAV_CMD
_UNSUPPORTED = 3  # MAV_RESULT
_CODES = {"ardupilot": 3, "px4": 12}  # MAV_AUTOPILOT
_REQUEST_ID, _VERSION_ID = 4 << 24 | 7 << 16 | 255, 148  # 4.7.0; AUTOPILOT_VERSION
_NO_SENSOR = ("GPS2_RAW", "SCALED_IMU3", "ATTITUDE_TARGET")
"""Messages that both autopilots promise, and do not send without the sensor (or, here, a controller)."""
_STREAMS = (*_FIELDS, *_NO_SENSOR)
"""Messages that can be requested."""
_GROUPS = {
    0: _STREAMS,
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "GPS_RAW_INT", "GPS2_RAW"),
    6: ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"),
    10: ("ATTITUDE",),
    12: ("EKF_STATUS_REPORT", "VIBRATION"),
}
"""MAV_DATA_STREAM → messages, as ArduPilot groups them: ALL, RAW_SENSORS, EXTENDED_STATUS, POSITION, EXTRA1, 3."""

_WITHOUT = {
    "ardupilot": {"SCALED_IMU", "ESTIMATOR_STATUS", "ODOMETRY"},
    "px4": {"RAW_IMU", "SCALED_IMU2", "EKF_STATUS_REPORT"},
}
_HEARTBEAT_US = 1_000_000
_MODE, _ARMED = 81, 128  # MAV_MODE_FLAG: manual input, stabilised, custom mode; armed
_AHEAD = 256  # messages whose payloads are made at a time, as arrays
PARAMETERS: Mapping[str, float] = {"AHRS_TRIM_X": 0.0, "AHRS_TRIM_Y": 0.0, "AHRS_ORIENTATION": 0.0}


class SimulatedVehicle:
    """An autopilot over a flight.

    It boots at t = 0 with no stream but `streams` (message → Hz; PX4 states no interval of those in `unlimited`), sends
    all its parameters then if `send_parameters`, answers a companion's requests by the rules of ArduPilot or PX4, and
    has `faults`. The same arguments and the same requests at the same times give the same packets.
    """

    def __init__(
        self,
        flown: Flown,
        *,
        autopilot: Autopilot = "ardupilot",
        sysid: int = 1,
        compid: int = 1,
        streams: Mapping[str, float] | None = None,
        unlimited: Collection[str] = frozenset(),
        parameters: Mapping[str, float] = PARAMETERS,
        send_parameters: bool = False,
        faults: Faults = Faults(),  # noqa: B008  (frozen)
        seed: int = 0,
    ) -> None:
        self.flown = flown
        self.received: Counter[str] = Counter()  # messages, by name
        self.sent: Counter[str] = Counter()  # messages made, by name, before the link loses any
        self.boots = 0  # how often it has started
        self._autopilot: Autopilot = autopilot
        self._ids = sysid, compid
        self._armed = flown.armed
        self._parameters = dict(parameters)
        self._send_parameters = send_parameters
        self._faults = faults
        rates = streams or {}
        self._unlimited = unlimited
        known = (name for name in _STREAMS if name not in _WITHOUT[autopilot])
        self._default = {name: round(1e6 / rates[name]) if name in rates else 0 for name in known}
        if autopilot == "px4":  # accepts messages that it has no source for, and never sends them
            self._default |= dict.fromkeys(_WITHOUT["px4"], 0)
        self._silent = faults.never.union(_NO_SENSOR, _WITHOUT["px4"] if autopilot == "px4" else ())
        self._channel = Channel(faults, seed)
        self._events = sorted([*((t, "reboot") for t in faults.reboot), *((t, "down") for t in faults.turned_down)])
        self._step = 0  # of the flight, the next to be done
        self._dialect = load_dialect()
        self._boot()

    @property
    def t(self) -> float:
        """Seconds of the flight that have been flown."""
        return self._step * LOOP_US * 1e-6

    @property
    def finished(self) -> bool:
        """Whether the flight is over."""
        return self._step >= len(self.flown)

    def interval_us(self, name: str) -> int:
        """The interval of a message in MESSAGE_INTERVAL: see `Intervals.get`."""
        return self._intervals.get(name)

    def reboot(self) -> None:
        """Start again at the next step: clock, sequence and intervals are gone."""
        self._events.insert(0, (self.t, "reboot"))

    def receive(self, data: bytes) -> None:
        """Take what somebody sent. Answers go out with the next `advance`."""
        received = split_messages(self._decoder.push(data), self._dialect)
        for name, messages in received.items():
            self.received[name] += len(messages)
            for row in messages.rows:
                self._answer(name, {field: row[field] for field in messages.layout.fields})

    def advance(self, until_s: float) -> list[tuple[float, bytes]]:
        """Fly on to `until_s` (s since the flight began): the packets that arrive, each with the time it was sent."""
        packets: list[tuple[float, bytes]] = []
        last = min(int(until_s * 1e6) // LOOP_US, len(self.flown) - 1)
        while (step := self._next_step()) <= last:
            self._step = step
            t = step * LOOP_US * 1e-6
            self._happen(t)
            now = self._boot_us()
            if now >= self._beat_us:
                self._beat_us += _HEARTBEAT_US
                code = _CODES[self._autopilot]
                begin, end = self._armed
                mode = _MODE | (_ARMED if begin <= t <= end else 0)
                self._send("HEARTBEAT", type=2, autopilot=code, base_mode=mode, system_status=4, mavlink_version=3)
            for name in self._intervals.due(now):
                if name not in self._silent:
                    self._measure(name, now)
            packets += self._channel.carry((t, packet) for packet in self._out)
            self._out.clear()
            self._step += 1
        self._step = max(self._step, last + 1)
        return packets

    def _next_step(self) -> int:
        """The next step at which there may be something to do."""
        if self._out:
            return self._step
        due = self._boot_step + math.ceil(min(self._beat_us, self._intervals.next_us) / LOOP_US)
        if self._events:
            due = min(due, int(self._events[0][0] * 1e6 / LOOP_US))
        return max(self._step, due)

    def _measure(self, name: str, now: int) -> None:
        layout = self._dialect.by_name[name]
        if now not in self._ready.get(name, {}):
            times = self._intervals.schedule(name, now, _AHEAD)
            steps = self._boot_step + times // LOOP_US
            times, steps = times[steps < len(self.flown)], steps[steps < len(self.flown)]
            made = _payloads(layout, self.flown, steps, times)
            self._ready[name] = dict(zip(times.tolist(), made, strict=True))
        self._out.append(self._packer.frame(layout, self._ready[name][now]))
        self.sent[name] += 1

    def _boot(self) -> None:
        self._boot_step = self._step
        self._beat_us = 0
        self._packer = Packer(*self._ids)
        self._decoder = Decoder(self._dialect, stamped=False)
        self._intervals = _Intervals(self._default, self._autopilot, unlimited=self._unlimited)
        self._out: list[bytes] = []
        self._ready: dict[str, dict[int, bytes]] = {}  # message → µs since boot → payload, made some way ahead
        banner = b"ArduCopter V4.7.0-simulated" if self._autopilot == "ardupilot" else b"PX4 simulated"
        self._send("STATUSTEXT", severity=6, text=banner)
        if self._send_parameters:
            for name in self._parameters:
                self._send_parameter(name)
        self.boots += 1

    def _happen(self, t: float) -> None:
        while self._events and self._events[0][0] <= t:
            _, event = self._events.pop(0)
            if event == "reboot":
                self._boot()
            else:
                for name in _STREAMS:
                    if self._intervals.get(name) > 0:
                        self._intervals.set(name, 500_000, self._boot_us())

    def _boot_us(self) -> int:
        return (self._step - self._boot_step) * LOOP_US

    def _send(self, name: str, **values: Value) -> None:
        self._out.append(self._packer.pack(name, values))
        self.sent[name] += 1

    def _send_parameter(self, name: str) -> None:
        self._send(
            "PARAM_VALUE", param_id=name.encode(), param_value=self._parameters[name], param_type=9,
            param_count=len(self._parameters), param_index=65535,
        )  # fmt: skip

    def _answer(self, name: str, message: dict[str, Any]) -> None:
        if name == "TIMESYNC" and message["tc1"] == 0:
            self._send("TIMESYNC", tc1=self._boot_us() * 1000, ts1=int(message["ts1"]))
            return
        if message.get("target_system") != self._ids[0] or message.get("target_component") not in (0, self._ids[1]):
            return
        if name == "PARAM_REQUEST_READ":
            parameter = bytes(message["param_id"]).split(b"\0")[0].decode("ascii", "replace")
            if parameter in self._parameters:
                self._send_parameter(parameter)
        elif name == "REQUEST_DATA_STREAM" and self._autopilot == "ardupilot":
            rate = int(message["req_message_rate"]) * int(message["start_stop"])
            for member in _GROUPS.get(int(message["req_stream_id"]), ()):
                self._intervals.set(member, 1e6 / rate if rate else -1, self._boot_us())
        elif name == "COMMAND_LONG":
            self._command(int(message["command"]), *(float(message[f"param{i}"]) for i in (1, 2, 3)))

    def _command(self, command: int, first: float, second: float, third: float) -> None:
        requested = self._dialect.by_id.get(int(first))
        name = requested.name if requested else ""
        result = _ACCEPTED
        if command == _GET_INTERVAL:
            self._send("MESSAGE_INTERVAL", message_id=int(first), interval_us=self._intervals.get(name))
        elif command == _SET_INTERVAL:
            refused = name in self._faults.denied or "*" in self._faults.denied
            denied = refused or (third != 0 and self._autopilot == "ardupilot")
            result = _DENIED if denied else self._intervals.set(name, second, self._boot_us())
        elif command == _REQUEST_MESSAGE and int(first) == _VERSION_ID:
            self._send("COMMAND_ACK", command=command, result=_ACCEPTED)  # ArduPilot acknowledges before it sends
            self._send("AUTOPILOT_VERSION", flight_sw_version=_REQUEST_ID)
            return
        else:
            result = _DENIED if command == _REQUEST_MESSAGE else _UNSUPPORTED
        self._send("COMMAND_ACK", command=command, result=result)


EPOCH = 1_700_000_000.0
"""UNIX time at which a flight written to a file begins, s: the same file for the same seed."""

_STEP_S = 0.005
"""Pause between sendings; ArduPilot's simulator sends in bursts too."""


def serve(
    vehicle: SimulatedVehicle, port: Port, *, speed: float = 1.0, stop: Callable[[], bool] = lambda: False
) -> None:
    """Fly the vehicle from where it is to its end, or until `stop()`, at `speed` times the pace of the clock."""
    begin = time.monotonic() - vehicle.t / speed
    while not vehicle.finished and not stop():
        port.wait(0.0)
        if data := port.read():
            vehicle.receive(data)
        for _, packet in vehicle.advance((time.monotonic() - begin) * speed):
            port.write(packet)
        time.sleep(_STEP_S)


def write_flight(vehicle: SimulatedVehicle, path: str | Path) -> None:
    """Fly the vehicle to its end and write what it sends as a tlog. Raises InputError if that cannot be written."""
    try:
        with Path(path).open("wb") as file:
            t = 0.0
            while not vehicle.finished:
                t += 1.0
                for sent, packet in vehicle.advance(t):
                    file.write(round((EPOCH + sent) * 1e6).to_bytes(8, "big") + packet)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}): choose another place.") from None
