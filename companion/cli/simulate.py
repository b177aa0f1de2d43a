"""`companion simulate`: a vehicle with known truth, on a link or into a telemetry log."""

from __future__ import annotations

import argparse
from pathlib import Path

from companion.cli import live, options
from companion.errors import SettingsError
from companion.mavlink import open_port, parse_address
from companion.simulate import MOTIONS, Faults, SimulatedVehicle, fly, serve, write_flight

_WRITTEN = {"RAW_IMU": 100.0, "HIGHRES_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0, "SIM_STATE": 20.0}
"""What a flight that is written to a file is made of, Hz; on a link nothing streams until it is asked for."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    summary = "Fly a simulated vehicle whose truth is known, on a link or into a telemetry log."
    example = "example: companion simulate udpout:127.0.0.1:14550 --duration 120"
    parser = commands.add_parser("simulate", help=summary, description=summary, epilog=example)
    parser.add_argument("link", metavar="LINK", nargs="?", help="udpout:HOST:PORT, tcpin:HOST:PORT, ...")
    parser.add_argument("-o", "--output", metavar="FILE", help="write the whole flight into this .tlog instead")
    parser.add_argument("--motion", choices=sorted(MOTIONS), default="circle", help="what it flies (default: circle)")
    parser.add_argument("--autopilot", choices=("ardupilot", "px4"), default="ardupilot", help="whose manners it has")
    parser.add_argument("--duration", type=float, default=600.0, metavar="S", help="seconds (default: 600)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="the same seed gives the same flight")
    parser.add_argument("--sysid", type=int, default=1, metavar="N", help="MAVLink system id (default: 1)")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME[@T]",
        help="imu-bias@T, ekf-reset@T, reboot@T, silence@T (10 s), or loss, duplicates, garbage; may be repeated",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly."""
    if (arguments.link is None) == (arguments.output is None):
        raise SettingsError("say either a LINK to fly on or a file with --output.")
    faults = faults_of(arguments.fault)
    flown = fly(arguments.duration, motion=arguments.motion, faults=faults, seed=arguments.seed)
    vehicle = SimulatedVehicle(
        flown,
        autopilot=arguments.autopilot,
        sysid=arguments.sysid,
        streams=_WRITTEN if arguments.output else {},
        faults=faults,
        seed=arguments.seed,
    )
    if arguments.output:
        write_flight(vehicle, arguments.output)
        print(f"{arguments.output}: {Path(arguments.output).stat().st_size:,} bytes, {flown.duration:.0f} s")
        return 0
    port = open_port(parse_address(arguments.link))
    try:
        options.say(f"Vehicle {arguments.sysid}:1 flies a {arguments.motion} on {arguments.link}  (Ctrl-C ends it)")
        with live.until_told() as told:
            serve(vehicle, port, stop=told)
    finally:
        port.close()
    print(f"sent {vehicle.sent.total():,} messages: " + ", ".join(f"{n} {c:,}" for n, c in vehicle.sent.most_common()))
    return 0


def faults_of(names: list[str]) -> Faults:
    """The faults that the command line names. Raises SettingsError for one that there is not."""
    found: dict[str, object] = {}
    for text in names:
        name, _, when = text.partition("@")
        try:
            t = float(when) if when else 10.0
        except ValueError:
            raise SettingsError(f"--fault {text}: {when!r} is no time in seconds.") from None
        known: dict[str, dict[str, object]] = {
            "imu-bias": {"imu_bias": (t, 0.02)},
            "ekf-reset": {"ekf_reset": (t, 10.0)},
            "reboot": {"reboot": (t,)},
            "silence": {"silence": ((t, t + 10.0),)},
            "loss": {"drop": 0.3},
            "duplicates": {"duplicate": 0.1, "reorder": 0.05},
            "garbage": {"garbage": 0.05},
        }
        if name not in known:
            raise SettingsError(f"there is no fault {name!r}: choose of {', '.join(known)}.")
        found |= known[name]
    return Faults(**found)  # type: ignore[arg-type]
