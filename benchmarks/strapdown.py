"""How fast and how exact the strapdown core is beside its peers, on one core: `python benchmarks/strapdown.py`.

Samples of coning at 200 Hz to attitude, velocity and position, all in one run of one process that is pinned to one
core. Speeds are samples per second by the median user CPU time of a few repetitions; a live push is timed by the wall.
Peers that are not installed are skipped with a line saying so (`pip install gtsam ahrs numba pypose`); slow ones get
fewer samples. Accuracy: the error at the end of 20 s of coning at 1.5 Hz and 0.4 rad.
"""

from __future__ import annotations

import argparse
import importlib
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")  # read when NumPy is imported

import numpy as np  # noqa: E402

from companion.model import STANDARD_GRAVITY, Array, ImuTrack, NavState  # noqa: E402
from companion.strapdown import DeadReckoner, Motion, dead_reckon, motions, preintegrate, propagate, quaternion  # noqa: E402

RATE = 200.0
End = tuple[Array, Array | None]  # attitude (4,) and position (3,) at the last sample; None: the peer has none


def user_seconds(run: Callable[[], object], repeats: int) -> float:
    """Median user CPU time of a call, after one to warm up."""
    run()
    times = []
    for _ in range(repeats):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        run()
        times.append(resource.getrusage(resource.RUSAGE_SELF).ru_utime - before)
    return statistics.median(times)


def push_microseconds(middle: str, size: int, motion: Motion) -> float:
    """Median wall time of pushing chunks of `size` samples."""
    chunks = [motion.imu[i : i + size] for i in range(0, 400 * size, size)]
    dead_reckoner = DeadReckoner(motion.start, middle=middle)
    times = []
    for chunk in chunks:
        before = time.perf_counter()
        dead_reckoner.push(chunk)
        times.append(time.perf_counter() - before)
    return 1e6 * statistics.median(times)


def peak_megabytes(motion: Motion, middle: str) -> float:
    """Peak resident memory of a process of its own that loads the samples and reckons once."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "samples.npz"
        np.savez(path, t=motion.t, gyro=motion.gyro, accel=motion.accel)
        command = [sys.executable, __file__, "--peak-memory-of", str(path), middle]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def reckon_in_this_process(path: str, middle: str) -> None:
    """The child of `peak_megabytes`: prints the peak in MB."""
    with np.load(path) as samples:
        imu = ImuTrack(samples["t"], samples["gyro"], samples["accel"])
    dead_reckon(imu, NavState(float(imu.t[0]), quaternion.IDENTITY, np.zeros(3), np.zeros(3)), middle=middle)
    # Not ru_maxrss: that survives exec, so a child would report its parent's peak.
    status = Path("/proc/self/status").read_text().split("VmHWM:")[1]
    print(float(status.split()[0]) / 1024)


# --- peers: each runs over a motion and gives its end ----------------------------------------------------------


def ours(middle: str, method: str = "rk4") -> Callable[[Motion], End]:
    def run(motion: Motion) -> End:
        end = dead_reckon(motion.imu, motion.start, method=method, middle=middle).end
        return end.q_ned_frd, end.position

    return run


def gtsam_loop(gtsam: Any) -> Callable[[Motion], End]:
    """PreintegratedImuMeasurements, sample by sample through its Python binding, mean of both ends."""
    params = gtsam.PreintegrationParams.MakeSharedD(STANDARD_GRAVITY)
    params.setGyroscopeCovariance(np.eye(3) * 1e-6)
    params.setAccelerometerCovariance(np.eye(3) * 1e-4)
    params.setIntegrationCovariance(np.eye(3) * 1e-8)

    def run(motion: Motion) -> End:
        out = gtsam.PreintegratedImuMeasurements(params, gtsam.imuBias.ConstantBias())
        gyro = 0.5 * (motion.gyro[1:] + motion.gyro[:-1])
        accel = 0.5 * (motion.accel[1:] + motion.accel[:-1])
        for f, w, h in zip(accel, gyro, np.diff(motion.t).tolist(), strict=True):
            out.integrateMeasurement(f, w, h)
        start = motion.start
        pose = gtsam.Pose3(gtsam.Rot3(*start.q_ned_frd), start.position)
        end = out.predict(gtsam.NavState(pose, start.velocity), gtsam.imuBias.ConstantBias())
        return quaternion.from_matrix(end.attitude().matrix()), end.position()

    return run


def ahrs_loop(ahrs: Any) -> Callable[[Motion], End]:
    """AngularRate in closed form; attitude alone."""

    def run(motion: Motion) -> End:
        solved = ahrs.filters.AngularRate(motion.gyro, q0=motion.start.q_ned_frd, frequency=RATE, method="closed")
        return np.asarray(solved.Q[-1]), None

    return run


def pypose_module(pypose: Any) -> Callable[[Motion], End]:
    """IMUPreintegrator on the CPU, double precision, one batch."""
    torch = importlib.import_module("torch")
    torch.set_num_threads(1)

    def run(motion: Motion) -> End:
        start = motion.start
        module = pypose.module.IMUPreintegrator(
            torch.tensor(start.position), pypose.SO3(torch.tensor(np.roll(start.q_ned_frd, -1))),
            torch.tensor(start.velocity), gravity=-STANDARD_GRAVITY, prop_cov=False, reset=True,
        ).double()  # fmt: skip
        h, gyro, accel = (
            torch.tensor(x[None]) for x in (np.diff(motion.t)[:, None], motion.gyro[1:], motion.accel[1:])
        )
        state = module(dt=h, gyro=gyro, acc=accel)
        return np.roll(state["rot"][0, -1].tensor().numpy(), 1), state["pos"][0, -1].numpy()

    return run


def scalar_loop(compile_: Callable[[Any], Any]) -> Callable[[Motion], End]:
    """RK4 with the linear middle, one sample after the other in scalars, as one would write it for numba."""

    @compile_
    def turn(w, x, y, z, a, b, c):  # type: ignore[no-untyped-def]  # C(q) f for any length of q
        k = 2.0 / (w * w + x * x + y * y + z * z)
        p, q, r = w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a
        return a + k * (y * r - z * q), b + k * (z * p - x * r), c + k * (x * q - y * p)

    @compile_
    def times(w, x, y, z, a, b, c):  # type: ignore[no-untyped-def]  # q ⊗ [0, a, b, c]
        return -x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a

    @compile_
    def loop(t, gyro, accel, q, v, p, g):  # type: ignore[no-untyped-def]
        for i in range(len(t) - 1):
            h = t[i + 1] - t[i]
            s = 0.5 * h
            ax, ay, az = s * gyro[i, 0], s * gyro[i, 1], s * gyro[i, 2]
            bx, by, bz = s * gyro[i + 1, 0], s * gyro[i + 1, 1], s * gyro[i + 1, 2]
            mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
            fx, fy, fz = accel[i, 0], accel[i, 1], accel[i, 2]
            ex, ey, ez = accel[i + 1, 0], accel[i + 1, 1], accel[i + 1, 2]
            cx, cy, cz = 0.5 * (fx + ex), 0.5 * (fy + ey), 0.5 * (fz + ez)
            k2 = times(1.0, 0.5 * ax, 0.5 * ay, 0.5 * az, mx, my, mz)
            k3 = times(1.0 + 0.5 * k2[0], 0.5 * k2[1], 0.5 * k2[2], 0.5 * k2[3], mx, my, mz)
            k4 = times(1.0 + k3[0], k3[1], k3[2], k3[3], bx, by, bz)
            a1 = turn(1.0, 0.5 * ax, 0.5 * ay, 0.5 * az, cx, cy, cz)
            a2 = turn(1.0 + 0.5 * k2[0], 0.5 * k2[1], 0.5 * k2[2], 0.5 * k2[3], cx, cy, cz)
            a3 = turn(1.0 + k3[0], k3[1], k3[2], k3[3], ex, ey, ez)
            w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            sx, sy, sz = a1[0] + a2[0], a1[1] + a2[1], a1[2] + a2[2]
            dv = turn(w, x, y, z, fx + 2 * sx + a3[0], fy + 2 * sy + a3[1], fz + 2 * sz + a3[2])
            dp = turn(w, x, y, z, fx + sx, fy + sy, fz + sz)
            for j in range(3):
                down = g if j == 2 else 0.0
                p[i + 1, j] = p[i, j] + h * v[i, j] + h * h / 6 * dp[j] + 0.5 * h * h * down
                v[i + 1, j] = v[i, j] + h / 6 * dv[j] + h * down
            dw = 1.0 + (2 * (k2[0] + k3[0]) + k4[0]) / 6
            dx = (ax + 2 * (k2[1] + k3[1]) + k4[1]) / 6
            dy = (ay + 2 * (k2[2] + k3[2]) + k4[2]) / 6
            dz = (az + 2 * (k2[3] + k3[3]) + k4[3]) / 6
            r = times(w, x, y, z, dx, dy, dz)
            w, x, y, z = r[0] + w * dw, r[1] + x * dw, r[2] + y * dw, r[3] + z * dw
            n = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
            q[i + 1, 0], q[i + 1, 1], q[i + 1, 2], q[i + 1, 3] = w * n, x * n, y * n, z * n

    def run(motion: Motion) -> End:
        n, start = len(motion.t), motion.start
        q, v, p = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
        q[0], v[0], p[0] = start.q_ned_frd, start.velocity, start.position
        loop(motion.t, motion.gyro, motion.accel, q, v, p, STANDARD_GRAVITY)
        return q[-1], p[-1]

    return run


PEERS: list[tuple[str, str, int, Callable[[Any], Callable[[Motion], End]]]] = [
    ("gtsam, Python loop", "gtsam", 100_000, gtsam_loop),
    ("ahrs AngularRate (attitude only)", "ahrs", 20_000, ahrs_loop),
    ("pypose IMUPreintegrator", "pypose", 200_000, pypose_module),
    ("numba, scalar loop (linear)", "numba", 1_000_000, lambda numba: scalar_loop(numba.njit)),
    ("plain Python and NumPy loop (linear)", "numpy", 5_000, lambda _: scalar_loop(lambda function: function)),
]


def report(name: str, run: Callable[[Motion], End], motion: Motion, truth: Motion, ours_speed: float) -> float:
    """One line of the table; the speed in samples per second."""
    speed = len(motion.t) / user_seconds(lambda: run(motion), 5)
    q, position = run(truth)
    turn = quaternion.log(quaternion.multiply(truth.q_ned_frd[-1], quaternion.conjugate(q)))
    degrees = np.degrees(np.linalg.norm(turn))
    metres = "-" if position is None else f"{np.linalg.norm(position - truth.position[-1]):.2g} m"
    ratio = f"{ours_speed / speed:8.1f}x" if ours_speed else " " * 9
    print(f"{name:40s} {speed / 1e6:8.3f} M/s {ratio}   {degrees:8.2g} deg  {metres:>10s}", flush=True)
    return speed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--peak-memory-of", nargs=2, metavar=("SAMPLES", "MIDDLE"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.peak_memory_of:
        reckon_in_this_process(*arguments.peak_memory_of)
        return
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

    def coning(n: int) -> Motion:
        return motions.coning(np.arange(n) / RATE)

    motion, truth = coning(arguments.samples), coning(round(20 * RATE) + 1)
    print(f"{len(motion.t):,} samples at {RATE:g} Hz, one core; ratio: companion's linear RK4 against the line")
    linear = report("companion RK4, linear middle", ours("linear"), motion, truth, 0.0)
    report("companion RK4, cubic middle", ours("cubic"), motion, truth, linear)
    report("companion midpoint", ours("linear", "midpoint"), motion, truth, linear)
    report("companion Euler", ours("linear", "euler"), motion, truth, linear)
    for name, module, samples, build in PEERS:
        try:
            run = build(importlib.import_module(module))
        except ImportError:
            print(f"{name:40s} skipped: {module} is not installed")
            continue
        report(name, run, coning(min(samples, arguments.samples)), truth, linear)
    for middle in ("linear", "cubic"):
        if Path("/proc/self/status").exists():
            print(f"peak memory, {middle}: {peak_megabytes(motion, middle):.0f} MB (interpreter and samples included)")
        print(
            f"live push, {middle}: {push_microseconds(middle, 1, motion):.0f} µs for 1 sample, "
            f"{push_microseconds(middle, 10, motion):.0f} µs for 10"
        )
    flight = motions.coning(np.arange(20_001) / 100)
    path, start = preintegrate(flight.imu), np.linspace(0, 19_500, 2000).astype(int)
    states = (flight.q_ned_frd[start], flight.velocity[start])
    seconds = user_seconds(lambda: propagate(flight.imu, path, start, start + 500, *states), 5)
    print(f"covariance and Jacobians of 2,000 windows of 5 s at 100 Hz: {seconds:.2f} s")
    carried = user_seconds(lambda: [path.carry(start, start + 500, *states, states[1]) for _ in range(100)], 5) / 100
    print(f"re-anchoring the same 2,000 windows: {1e3 * carried:.2f} ms")


if __name__ == "__main__":
    main()
