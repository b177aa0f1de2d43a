"""How fast logs are read beside pymavlink, fasttlogparser and pyulog, on one core: `python benchmarks/readers.py`.

A log of 50 MB with the message mix of a real link (made here, from a fixed seed) is read by each, in one run; each
repetition is a process of its own, so that CPU and peak memory are its own, without the interpreter's start and the
import of NumPy. Speeds are by user CPU, and by all: who fills 900 MB has the kernel make them. pymavlink reads the
first twentieth, which is enough to know its speed. Peers that are not installed are named and skipped (fasttlogparser
has no wheel: `pip install fasttlogparser` needs a C++ compiler). Then the same for a ULog, made here too, and for a
DataFlash log, made of a recording again and again.
"""

from __future__ import annotations

import argparse
import cProfile
import importlib.util
import lzma
import os
import pstats
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from companion.logs import read_dataflash, read_tlog, read_ulog
from companion.mavlink import Messages, load_dialect
from tests.tlogs import packed

# Message -> Hz on an ArduPilot link whose IMU, attitude and position were asked for, as in our own recordings.
MIX = {
    "RAW_IMU": 100, "ATTITUDE": 50, "SCALED_IMU2": 25, "LOCAL_POSITION_NED": 20, "GLOBAL_POSITION_INT": 10,
    "SERVO_OUTPUT_RAW": 4, "RC_CHANNELS": 4, "VFR_HUD": 4, "NAV_CONTROLLER_OUTPUT": 4, "AHRS": 4, "AHRS2": 4,
    "SYS_STATUS": 2, "POWER_STATUS": 2, "MEMINFO": 2, "MISSION_CURRENT": 2, "GPS_RAW_INT": 2, "SCALED_PRESSURE": 2,
    "EKF_STATUS_REPORT": 2, "VIBRATION": 2, "BATTERY_STATUS": 2, "SYSTEM_TIME": 2, "TIMESYNC": 2, "PARAM_VALUE": 2,
    "HEARTBEAT": 1, "STATUSTEXT": 1,
}  # fmt: skip
TRACKS = ("RAW_IMU", "ATTITUDE", "LOCAL_POSITION_NED")


# Topic of PX4's high-rate profile -> Hz and its fields: those of v1.16 that are long or that tracks are made of.
ULOG_MIX = {
    "sensor_combined": (250, "Q timestamp;3f gyro_rad;I gyro_integral_dt;i accelerometer_timestamp_relative;"
                             "3f accelerometer_m_s2;I accelerometer_integral_dt;B accelerometer_clipping"),
    "vehicle_imu": (200, "Q timestamp;Q timestamp_sample;I accel_device_id;I gyro_device_id;3f delta_angle;"
                         "3f delta_velocity;I delta_angle_dt;I delta_velocity_dt;B delta_angle_clipping"),
    "vehicle_attitude": (200, "Q timestamp;Q timestamp_sample;4f q;4f delta_q_reset;B quat_reset_counter"),
    "vehicle_angular_velocity": (200, "Q timestamp;Q timestamp_sample;3f xyz;3f xyz_derivative"),
    "vehicle_rates_setpoint": (200, "Q timestamp;f roll;f pitch;f yaw;3f thrust_body;B reset_integral"),
    "actuator_motors": (200, "Q timestamp;Q timestamp_sample;H reversible_flags;12f control"),
    "rate_ctrl_status": (200, "Q timestamp;f rollspeed_integ;f pitchspeed_integ;f yawspeed_integ"),
    "vehicle_attitude_setpoint": (100, "Q timestamp;4f q_d;3f thrust_body;B reset_integral"),
    "vehicle_local_position": (100, "Q timestamp;Q timestamp_sample;d ref_lat;d ref_lon;f x;f y;f z;f vx;f vy;f vz;"
                                    "f ref_alt;B xy_valid;B z_valid;B v_xy_valid;B v_z_valid;B xy_global"),
    "estimator_states": (25, "Q timestamp;Q timestamp_sample;25f states;24f covariances;B n_states"),
    "estimator_sensor_bias": (25, "Q timestamp;Q timestamp_sample;I gyro_device_id;3f gyro_bias;3f gyro_bias_variance;"
                                  "I accel_device_id;3f accel_bias;3f accel_bias_variance"),
    "vehicle_magnetometer": (50, "Q timestamp;Q timestamp_sample;I device_id;3f magnetometer_ga"),
    "vehicle_air_data": (50, "Q timestamp;Q timestamp_sample;I baro_device_id;f baro_alt_meter;f baro_pressure_pa"),
    "sensor_gps": (5, "Q timestamp;Q timestamp_sample;d latitude_deg;d longitude_deg;d altitude_msl_m;f vel_n_m_s;"
                      "f vel_e_m_s;f vel_d_m_s;f eph;f epv;B fix_type;B vel_ned_valid"),
    "vehicle_status": (2, "Q timestamp;B arming_state;B nav_state"),
}  # fmt: skip
ULOG_TYPES = {
    "Q": "uint64_t",
    "I": "uint32_t",
    "i": "int32_t",
    "H": "uint16_t",
    "B": "uint8_t",
    "f": "float",
    "d": "double",
}
ULOG_VALUES: dict[str, float | tuple[float, ...]] = {
    "gyro_integral_dt": 4000, "accelerometer_m_s2": (0, 0, -9.8), "gyro_device_id": 7, "accel_device_id": 7,
    "device_id": 8, "delta_velocity": (0, 0, -0.049), "delta_angle_dt": 5000, "delta_velocity_dt": 5000,
    "q": (1, 0, 0, 0), "delta_q_reset": (1, 0, 0, 0), "q_d": (1, 0, 0, 0), "xy_valid": 1, "z_valid": 1,
    "v_xy_valid": 1, "v_z_valid": 1,
    "magnetometer_ga": (0.2, 0, 0.4), "baro_device_id": 9, "baro_pressure_pa": 96_000, "baro_alt_meter": 450,
    "latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_msl_m": 450, "fix_type": 3, "vel_ned_valid": 1,
    "arming_state": 2, "nav_state": 4, "control": 0.5,
}  # fmt: skip


def ulog_stretch(begin: float, seconds: float) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """The data of a stretch of a ULog, in order of time; values as varied as measurements are."""
    rng = np.random.default_rng(round(begin))
    times, parts = [], []
    for number, (hertz, fields) in enumerate(ULOG_MIX.values()):
        t = begin + (np.arange(round(seconds * hertz)) + rng.uniform()) / hertz
        layout = np.dtype([("size", "<u2"), ("type", "u1"), ("number", "<u2"), *_ulog_fields(fields)])
        rows = np.zeros(len(t), layout)
        rows["size"], rows["type"], rows["number"] = layout.itemsize - 3, ord("D"), number
        for name in (layout.names or ())[3:]:
            value = np.array(ULOG_VALUES.get(name, 0))
            if name.startswith("timestamp"):
                rows[name] = t * 1e6
            elif layout[name].base.kind == "f":
                rows[name] = value + rng.normal(0.0, 1e-3, rows[name].shape)
            else:
                rows[name] = value
        times.append(t)
        parts.append(rows.view(np.uint8).reshape(len(t), -1))
    sizes = np.repeat([part.shape[1] for part in parts], [len(part) for part in parts])
    order = np.argsort(np.concatenate(times), kind="stable")
    at = np.empty(len(order), np.int64)
    at[order] = np.cumsum(sizes[order]) - sizes[order]
    out, first = np.empty(int(sizes.sum()), np.uint8), 0
    for part in parts:
        out[at[first : first + len(part), None] + np.arange(part.shape[1])] = part
        first += len(part)
    return out


def _ulog_fields(fields: str) -> list[Any]:
    """NumPy's of "Q timestamp;3f gyro_rad"."""
    pairs = [field.split(" ") for field in fields.split(";")]
    return [(name, f"<{kind[-1]}", (int(kind[:-1]),)) if kind[:-1] else (name, f"<{kind}") for kind, name in pairs]


def make_ulog(path: Path, megabytes: float) -> None:
    """A log of about that size, written stretch by stretch, with a sync mark between them."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    with path.open("wb") as file:
        file.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000) + message("B", bytes(40)))
        for name, (_, fields) in ULOG_MIX.items():
            declared = [
                f"{ULOG_TYPES[kind[-1]]}{f'[{kind[:-1]}]' if kind[:-1] else ''} {field};"
                for kind, field in (one.split(" ") for one in fields.split(";"))
            ]
            file.write(message("F", f"{name}:{''.join(declared)}".encode()))
        file.write(b"".join(message("A", struct.pack("<BH", 0, i) + n.encode()) for i, n in enumerate(ULOG_MIX)))
        begin = 1.0
        while file.tell() < megabytes * 1e6:
            file.write(ulog_stretch(begin, 5.0).data)
            file.write(message("S", bytes.fromhex("2F731320250CBB12")))
            begin += 5.0


def link_traffic(seconds: float, epoch: float) -> bytes:
    """A stretch of a link as the bytes of a tlog; values as varied as measurements are, one message in three with a
    trailing zero field for MAVLink 2 to trim."""
    rng = np.random.default_rng(round(epoch) % 2**32)
    dialect = load_dialect()
    everything = []
    for name, hertz in MIX.items():
        layout = dialect.by_name[name]
        t = (np.arange(round(seconds * hertz)) + rng.uniform()) / hertz
        rows = np.zeros(len(t), layout.dtype)
        for field in layout.fields:
            kind = layout.dtype[field]
            shape = (len(t), *kind.shape)
            if field == "time_boot_ms":
                rows[field] = t * 1e3
            elif field == "time_usec":
                rows[field] = t * 1e6
            elif kind.base.kind == "f":
                rows[field] = rng.normal(size=shape)
            elif kind.base.kind == "S":
                rows[field] = b"INS_GYRO_FILTER"
            else:
                spread = min(1000, np.iinfo(kind.base).max)
                low = -spread if kind.base.kind == "i" else 0
                rows[field] = rng.integers(low, spread, shape)
        if name == "HEARTBEAT":
            for field, value in {"type": 2, "autopilot": 3, "base_mode": 81, "custom_mode": 4}.items():
                rows[field] = value
        rows[layout.fields[-1]] = np.where(rng.random(len(t)) < 1 / 3, 0, 1) if layout.dtype[-1].kind in "iuf" else b""
        ids, count = np.ones(len(t), np.uint8), np.arange(len(t))
        everything.append(
            Messages(layout, count, epoch + t, ids, ids, count.astype(np.uint8), np.zeros(len(t), np.uint16), rows)
        )
    return packed(everything)


def make_log(path: Path, megabytes: float) -> None:
    """A log of about that size, written stretch by stretch."""
    size, epoch = 0, 1_700_000_000.0
    with path.open("wb") as file:
        while size < megabytes * 1e6:
            size += file.write(link_traffic(600.0, epoch))
            epoch += 600.0


def read_everything(path: Path) -> int:
    """All fields of all messages."""
    return read_tlog(path).frames


def read_for_tracks(path: Path) -> int:
    """Every CRC checked, the fields of IMU, attitude and position alone."""
    return read_tlog(path, names=TRACKS).frames


def read_flights(path: Path) -> int:
    """All messages, and the SI tracks of the flights in them."""
    from companion.app.recording import read_recording  # noqa: PLC0415  (its imports are not timed for the others)

    return read_recording(path).source.frames


def pymavlink(path: Path) -> int:
    from pymavlink import mavutil  # noqa: PLC0415

    log: Any = mavutil.mavlogfile(str(path))
    frames = 0
    while log.recv_msg() is not None:
        frames += 1
    return frames


def fasttlogparser(path: Path) -> int:
    module: Any = importlib.import_module("fasttlogparser")
    messages, _ = module.parseTLog(str(path))
    return sum(len(next(iter(fields.values()))) for fields in messages.values())


def read_onboard(path: Path) -> int:
    """All fields of all records."""
    return read_dataflash(path).frames


def read_px4(path: Path) -> int:
    """All fields of all topics."""
    return read_ulog(path).frames


def pyulog(path: Path) -> int:
    from pyulog import ULog  # noqa: PLC0415

    log: Any = ULog(str(path))
    return sum(len(topic.data["timestamp"]) for topic in log.data_list)


def dfreader(path: Path) -> int:
    from pymavlink.DFReader import DFReader_binary  # noqa: PLC0415

    reader: Any = DFReader_binary(str(path))
    records = 0
    while reader.recv_msg() is not None:
        records += 1
    return records


READERS: dict[str, Callable[[Path], int]] = {
    "companion: all fields": read_everything,
    "companion: IMU, attitude, position": read_for_tracks,
    "companion: flights with SI tracks": read_flights,
    "fasttlogparser": fasttlogparser,
    "pymavlink": pymavlink,
}
ONBOARD: dict[str, Callable[[Path], int]] = {"companion: on-board log": read_onboard, "pymavlink: DFReader": dfreader}
PX4: dict[str, Callable[[Path], int]] = {
    "companion: ULog, all fields": read_px4,
    "companion: ULog, flight with SI tracks": read_flights,
    "pyulog": pyulog,
}
RECORDINGS = Path(__file__).resolve().parents[1] / "tests" / "data"
ON_BOARD, ON_PX4 = "dataflash__sitl__copter-demo.BIN.xz", "px4__px4_gcs_default.ulg.xz"


def measure(reader: str, path: Path) -> None:
    """In a process of its own: print frames, user CPU s, all CPU s, wall s and peak MB."""
    read = (READERS | ONBOARD | PX4)[reader]
    read(_warm(path))
    before, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    frames = read(path)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF)
    user = after.ru_utime - before.ru_utime
    print(frames, user, user + after.ru_stime - before.ru_stime, wall, _peak_megabytes())


def _peak_megabytes() -> float:
    """Of this process; what getrusage says is that of its parent, where that is more."""
    status = Path("/proc/self/status")
    if status.exists():
        return next(float(line.split()[1]) / 1024 for line in status.open() if line.startswith("VmHWM"))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _warm(path: Path) -> Path:
    """The first 100 kB: reading them loads every module."""
    warm = path.with_name(f"{path.name}.warm")
    if not warm.exists():
        with path.open("rb") as file:
            warm.write_bytes(file.read(100_000))
    return warm


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=50.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--measure", nargs=2, metavar=("READER", "LOG"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.measure[0], Path(arguments.measure[1]))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder, size = Path(temporary), arguments.megabytes
        whole, part = folder / "whole.tlog", folder / "part.tlog"
        make_log(whole, size)
        with whole.open("rb") as file:
            part.write_bytes(file.read(whole.stat().st_size // 20))
        beside({reader: part if reader == "pymavlink" else whole for reader in READERS}, arguments.repeats)
        next_limit(whole)

        whole, recorded = folder / "whole.ulg", folder / "recorded.ulg"
        make_ulog(whole, size)
        recorded.write_bytes(lzma.decompress((RECORDINGS / ON_PX4).read_bytes()))
        for path in (whole, recorded):
            beside(dict.fromkeys(PX4, path), arguments.repeats)
        next_limit(whole)

        whole, part = folder / "whole.bin", folder / "part.bin"
        recording = lzma.decompress((RECORDINGS / ON_BOARD).read_bytes())
        part.write_bytes(recording)
        with whole.open("wb") as file:
            for _ in range(round(size * 1e6 / len(recording))):
                file.write(recording)
        beside({reader: part if reader == "pymavlink: DFReader" else whole for reader in ONBOARD}, arguments.repeats)


def beside(logs: dict[str, Path], repeats: int) -> None:
    """Print the table of each reader with its log, and the ratio of each of ours to each peer that is installed."""
    speeds = compare(logs, repeats)
    peers = [reader for reader in speeds if not reader.startswith("companion")]
    for reader in speeds:
        if reader not in peers:
            for peer in peers:
                print(f"{reader} beside {peer}: {_ratio(speeds[reader], speeds[peer])}")


def next_limit(path: Path) -> None:
    """Print where the time of reading flights goes, by part: what a faster reader would have to make faster."""
    from companion.app.recording import read_recording  # noqa: PLC0415

    profile = cProfile.Profile()
    profile.runcall(read_recording, path)
    own: Counter[str] = Counter()
    for (file, _, function), (_, _, seconds, _, callers) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if "companion" in file:
            own[Path(file).stem] += seconds
        else:  # of NumPy's functions the time is its callers'
            for (caller, _, _), (_, _, theirs, _) in callers.items():
                own[Path(caller).stem if "companion" in caller else function] += theirs
    shares = ", ".join(f"{name} {seconds / own.total():.0%}" for name, seconds in own.most_common(6))
    print(f"where the time goes (profiled): {shares}")


def compare(logs: dict[str, Path], repeats: int) -> dict[str, tuple[float, float]]:
    """Print the medians of each reader, each with its log, as a table. Returns MB per s of user CPU, and of all."""
    print(f"\n{'':40}{'MB':>6}{'MB/s':>8}{'s user':>9}{'s CPU':>9}{'s wall':>9}{'peak MB':>9}{'frames':>12}")
    speeds = {}
    for reader, path in logs.items():
        if importlib.util.find_spec(reader.partition(":")[0]) is None:
            print(f"{reader:40}not installed")
            continue
        megabytes = path.stat().st_size / 1e6
        frames, user, cpu, wall, peak = _medians(reader, path, repeats)
        speeds[reader] = megabytes / user, megabytes / cpu
        times = f"{user:9.2f}{cpu:9.2f}{wall:9.2f}"
        print(f"{reader:40}{megabytes:6.0f}{speeds[reader][0]:8.1f}{times}{peak:9.0f}{round(frames):12,}")
    return speeds


def _ratio(ours: tuple[float, float], theirs: tuple[float, float]) -> str:
    """By user CPU, and by all CPU."""
    return f"{ours[0] / theirs[0]:.2f} x by user CPU, {ours[1] / theirs[1]:.2f} x by all CPU"


def _medians(reader: str, path: Path, repeats: int) -> list[float]:
    command = [sys.executable, __file__, "--measure", reader, str(path)]
    environment = os.environ | {"MAVLINK20": "1", "OPENBLAS_NUM_THREADS": "1"}
    runs = []
    for _ in range(repeats):
        printed = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
        runs.append([float(value) for value in printed.splitlines()[-1].split()])  # fasttlogparser prints before
    return [statistics.median(column) for column in zip(*runs, strict=True)]


if __name__ == "__main__":
    main()
