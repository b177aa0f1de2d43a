"""A vehicle's packets on a link without the vehicle: `companion simulate` and `companion replay`."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from companion.app import files
from companion.app.sensors import ardupilot_id, load_imu_spec
from companion.cli import live, options
from companion.comparison import ImuSpec, SensorSpec
from companion.links import Address, Port, open_port, parse_address, play
from companion.logs import log_format
from companion.mavlink import load_dialect
from companion.model import DataError, Flight, InputError, SettingsError
from companion.simulate import MOTIONS, PARAMETERS, Faults, SimulatedVehicle, fly, serve, write_flight
from companion.strapdown import ImuModel, Sensor

_WRITTEN = {
    "RAW_IMU": 100.0, "SCALED_IMU": 100.0, "SCALED_IMU2": 100.0, "HIGHRES_IMU": 100.0, "ATTITUDE": 50.0,
    "LOCAL_POSITION_NED": 20.0, "GLOBAL_POSITION_INT": 5.0, "SYS_STATUS": 1.0, "SIM_STATE": 20.0,
    "GPS_RAW_INT": 5.0, "SCALED_PRESSURE": 10.0,
}  # fmt: skip
"""What a flight that is written to a file is made of, Hz; on a link nothing streams until it is requested."""

_DEFAULT_PART = "icm-42688-p"
_seed = options.whole(0, 2**63 - 1, "a whole number from 0 on")


def simulate_options(parser: options.Parser) -> None:
    """The command's options."""
    parser.add_argument("link", metavar="LINK", nargs="?", help="udpout:HOST:PORT, tcpin:HOST:PORT, ...")
    options.add_output(parser, "FILE", "write the whole flight into this .tlog instead", "replace FILE")
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="square", help="motion (default: square)")
    parser.add_argument(
        "--autopilot", choices=("ardupilot", "px4"), default="ardupilot", help="the autopilot to imitate"
    )
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="seconds (default: 600)")
    parser.add_argument("--seed", type=_seed, default=0, metavar="N", help="the same seed gives the same flight")
    parser.add_argument("--sysid", type=int, default=1, metavar="N", help="MAVLink system id (default: 1)")
    options.add(parser, "--imu-model")
    parser.add_argument(
        "--imu-filter",
        type=float,
        default=0.0,
        metavar="HZ",
        help="the autopilot's low-pass over its IMU; ArduPilot: 20",
    )
    parser.add_argument(
        "--latency", type=float, default=0.0, metavar="S", help="age of the autopilot's estimate, seconds (default: 0)"
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME[@T]",
        help="imu-bias@T, imu-stuck@T, imu-clip@T (10 s), gps-glitch@T (20 s), ekf-reset@T, reboot@T, silence@T "
        "(10 s), or loss, duplicates, garbage; may be repeated, each once but for reboot and silence",
    )


def run_simulate(arguments: argparse.Namespace) -> int:
    """Fly."""
    if (arguments.link is None) == (arguments.output is None):
        raise SettingsError("name either a LINK to fly on or a file with --output.")
    if not 1 <= arguments.sysid <= 255:
        raise SettingsError(f"--sysid lies between 1 and 255, got {arguments.sysid}.")
    path = options.output(arguments)
    faults = faults_of(arguments.fault, arguments.duration)
    part = arguments.imu_model or _DEFAULT_PART
    flown = fly(
        arguments.duration,
        motion=arguments.motion,
        model=model_of(load_imu_spec(part), arguments.seed),
        faults=faults,
        filter_hz=arguments.imu_filter,
        latency_s=arguments.latency,
        seed=arguments.seed,
    )
    filters = dict.fromkeys(("INS_GYRO_FILTER", "INS_ACCEL_FILTER"), arguments.imu_filter)
    vehicle = SimulatedVehicle(
        flown,
        autopilot=arguments.autopilot,
        sysid=arguments.sysid,
        streams=_WRITTEN if path is not None else {},
        parameters={**PARAMETERS, **filters, "INS_GYR_ID": float(ardupilot_id(part))},
        send_parameters=path is not None,
        faults=faults,
        seed=arguments.seed,
    )
    if path is not None:
        with files.replacing(path) as draft:
            write_flight(vehicle, draft)
        print(f"{path}: {path.stat().st_size:,} bytes, {flown.duration:.0f} s")
        return 0
    with contextlib.closing(open_port(parse_address(arguments.link))) as port:
        options.say(f"Vehicle {arguments.sysid}:1 flies a {arguments.motion} on {arguments.link}  (Ctrl-C ends it)")
        with live.until_signal() as ended:
            serve(vehicle, port, stop=ended)
    print(f"sent {vehicle.sent.total():,} messages: " + ", ".join(f"{n} {c:,}" for n, c in vehicle.sent.most_common()))
    return 0


def model_of(spec: ImuSpec, seed: int) -> ImuModel:
    """An IMU of this part: its noise and range, and biases and scales as calibration leaves them, drawn by the seed."""
    rng = np.random.default_rng(seed)

    def sensor(part: SensorSpec) -> Sensor:
        return Sensor(
            noise_density=part.noise_density,
            bias_walk=part.bias_walk,
            bias=rng.normal(0.0, part.residual_bias, 3),
            matrix=np.eye(3) + np.diag(rng.normal(0.0, part.scale, 3)),
            full_scale=part.full_scale,
        )

    return ImuModel(gyro=sensor(spec.gyro), accel=sensor(spec.accel))


_FAULTS: Mapping[str, Callable[[float], dict[str, Any]]] = {
    "imu-bias": lambda t: {"imu_bias": (t, 0.02)},
    "imu-stuck": lambda t: {"imu_stuck": t},
    "imu-clip": lambda t: {"imu_clip": (t, t + 10.0)},
    "gps-glitch": lambda t: {"gps_glitch": (t, t + 20.0, 30.0)},
    "ekf-reset": lambda t: {"ekf_reset": (t, 10.0)},
    "reboot": lambda t: {"reboot": (t,)},
    "silence": lambda t: {"silence": ((t, t + 10.0),)},
    "loss": lambda _: {"drop": 0.3},
    "duplicates": lambda _: {"duplicate": 0.1, "reorder": 0.05},
    "garbage": lambda _: {"garbage": 0.05},
}
"""Name of a fault → the arguments of `Faults` for one at a time, s."""

_THROUGHOUT = ("loss", "duplicates", "garbage")
"""Names of faults that last from the first packet to the last."""

_REPEATED = ("reboot", "silence")
"""The arguments of `Faults` that hold one for each time."""


def faults_of(names: list[str], duration_s: float = np.inf) -> Faults:
    """The faults that the command line names. Raises SettingsError for one that there is not, or not in the flight."""
    chosen: dict[str, Any] = {}
    for text in names:
        name, _, when = text.partition("@")
        try:
            t = float(when or 10.0)
        except ValueError:
            t = -1.0
        if not 0 <= t < np.inf:
            raise SettingsError(f"--fault {text}: {when!r} is not a time in seconds.")
        if name not in _FAULTS:
            raise SettingsError(f"there is no fault {name!r}: choose of {', '.join(_FAULTS)}.")
        if t >= duration_s and name not in _THROUGHOUT:
            raise SettingsError(
                f"--fault {text}: the flight is over at {duration_s:g} s, and {name} begins at {t:g} s."
            )
        for field, value in _FAULTS[name](t).items():
            if field in chosen and field not in _REPEATED:
                raise SettingsError(f"--fault {text}: there is one {name} in a flight, and it is given twice.")
            chosen[field] = (*chosen.get(field, ()), *value) if field in _REPEATED else value
    return Faults(**chosen)


_WAITING = ("udpin", "tcpin", "tcp")  # links on which the peer has to send or listen first


def replay_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser)
    parser.add_argument(
        "link", metavar="LINK", help="udpout:HOST:PORT, udpin:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT"
    )
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="times the pace of the log (default: 1)")
    parser.add_argument(
        "--everybody",
        action="store_true",
        help="send the frames of ground stations, companion computers and others too, with their commands: for closed "
        "networks only",
    )


def run_replay(arguments: argparse.Namespace) -> int:
    """Play the log to its end, or until Ctrl-C."""
    if not 0 < arguments.speed <= 1000:
        raise SettingsError(f"--speed lies above 0 and up to 1000, got {arguments.speed:g}.")
    address = parse_address(arguments.link)
    if address.kind == "serial":
        raise SettingsError(
            f"replay does not send to a serial port: there may be a vehicle on {address.device}. Use a UDP or TCP link."
        )
    settings = options.settings_of(arguments)
    path = options.log_path(arguments)
    if log_format(path) != "mavlink":
        raise InputError(f"{path} is not a telemetry log: only a .tlog holds packets that can be sent again.")
    senders = None if arguments.everybody else _autopilots(options.read(arguments, settings).flights, path)
    with contextlib.closing(open_port(address)) as port, live.until_signal() as ended:
        _wait(port, address, ended)
        options.say(f"Replaying {path} on {address} at {arguments.speed:g} times its pace  (Ctrl-C ends it)")
        dialect = load_dialect(settings.log.dialect)
        played = play(path, port, dialect, senders=senders, speed=arguments.speed, stop=ended)
    names = ", ".join(f"{name} {count:,}" for name, count in played.sent.most_common())
    print(f"sent {played.sent.total():,} frames, {played.bytes:,} bytes: {names}")
    if played.unheard:
        options.say(f"{played.unheard:,} frames more were due while nobody was there to hear them")
    if played.left_out:
        others = ", ".join(f"{who} ({count:,})" for who, count in played.left_out.most_common())
        options.say(f"left out, for they are not the autopilot's (--everybody sends them too): frames of {others}")
    return 0


def _autopilots(flights: Sequence[Flight], path: Path) -> set[tuple[int, int]]:
    """Those in the log. Not their companion computers: those send commands to an autopilot."""
    if not flights:
        raise DataError(f"no vehicle found in {path}. To send the messages of others: --everybody.")
    return {(flight.vehicle.sysid, flight.vehicle.compid) for flight in flights}


def _wait(port: Port, address: Address, ended: Callable[[], bool]) -> None:
    """Until there is somebody to send to, where a link needs that."""
    if address.kind not in _WAITING:
        return
    if port.problem:
        options.say(f"{address}: {port.problem}; waiting")
    while port.problem and not ended():
        port.wait(0.05)
        port.read()
        time.sleep(0.01)
