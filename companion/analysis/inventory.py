"""What a flight has: every sensor and every estimate in it, its rate and its gaps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from companion.model import STANDARD_GRAVITY, Array, Flight, FlowTrack, GpsTrack, ImuTrack, RangeTrack, longest_step

_SERIES = {
    "vibration": "vibration", "attitude": "other attitude", "estimator": "test ratios", "innovation": "innovations",
    "variance": "variances", "accuracy": "accuracies", "test_ratio": "test ratios", "aiding": "aiding",
    "inconsistency": "between IMUs",
    "gyro_batch": "batches", "accel_batch": "batches",
}  # fmt: skip
"""Kind of a series → its name here. Other sensors have tracks; thermometers belong to the IMUs."""

_ORIENTATIONS = {0: "forward", 2: "right", 4: "back", 6: "left", 24: "up", 25: "down"}
"""MAV_SENSOR_ORIENTATION of those that are usual."""


@dataclass(frozen=True, slots=True)
class Item:
    """One sensor or estimate of a flight."""

    kind: str
    source: str  # the message, record or topic
    samples: int
    rate_hz: float | None  # samples per second from the first to the last; None for fewer than two
    gaps: int
    longest_gap_s: float | None
    about: str = ""  # what else is known of it, in words


def inventory(flight: Flight) -> tuple[Item, ...]:
    """Everything that a flight has, sensors first."""
    return tuple(_items(flight))


def used_imus(flight: Flight) -> str:
    """Which IMU the estimator used when, in words; "" where the log does not tell."""
    used = flight.imu_in_use
    if used is None or not len(used.t):
        return ""
    later = "".join(f", IMU {i} from {t:.1f} s" for t, i in used.changes[1:])
    return f"IMU {used.instance[0]}{later} ({used.source})"


def used_aiding(flight: Flight) -> str:
    """Which receiver, compass, barometer and airspeed sensor the estimator used when; "" where it is not told."""
    return "; ".join(
        f"{kind} " + ", ".join(f"{i}{f' from {t:.1f} s' if n else ''}" for n, (t, i) in enumerate(used.changes))
        for kind, used in flight.aiding_in_use.items()
    )


def _sensors(flight: Flight) -> Iterator[Item]:
    for imu in flight.imus.values():
        yield _item("IMU", imu.source, imu.t, _about_imu(imu))
    for gps in flight.gps:
        yield _item("GPS", gps.source, gps.t, _about_gps(gps))
    for compass in flight.compasses:
        yield _item("compass", compass.source, compass.t, "" if compass.calibrated else "not calibrated")
    for barometer in flight.barometers:
        yield _item("barometer", barometer.source, barometer.t)
    for airspeed in flight.airspeeds:
        measured = np.isfinite(airspeed.airspeed).any()
        yield _item("airspeed", airspeed.source, airspeed.t, "" if measured else "differential pressure alone")
    for finder in flight.ranges:
        yield _item("range finder", finder.source, finder.t, _about_range(finder))
    for flow in flight.flows:
        yield _item("optical flow", flow.source, flow.t, _about_flow(flow))


def _items(flight: Flight) -> Iterator[Item]:
    yield from _sensors(flight)
    if flight.attitude is not None:
        yield _item("attitude", flight.attitude.source, flight.attitude.t)
    if flight.position is not None:
        yield _item("position", flight.position.source, flight.position.t)
    for bias in flight.biases:
        of = "" if bias.imu_instance is None else f"of IMU {bias.imu_instance}"
        yield _item("IMU bias", bias.source, bias.t, of)
    if flight.control is not None:
        yield _item("desired attitude", flight.control.source, flight.control.t)
    if flight.actuators is not None:
        outputs = int(np.isfinite(flight.actuators.output).any(axis=0).sum())
        yield _item("motors and servos", flight.actuators.source, flight.actuators.t, f"{outputs} outputs")
    for key in flight.series:
        if (name := _SERIES.get(key.partition(":")[0])) is not None:
            series = flight.series[key]
            yield _item(name, series.source, series.t)
    if flight.truth is not None:
        yield _item("truth", flight.truth.source, flight.truth.t, "a simulator's: never an input")


def _item(kind: str, source: str, t: Array, about: str = "") -> Item:
    steps = np.diff(t)
    if not len(steps):
        return Item(kind, source, len(t), None, 0, None, about)
    rate, gaps = len(steps) / float(t[-1] - t[0]), int((steps > longest_step(t)).sum())
    return Item(kind, source, len(t), rate, gaps, float(steps.max()), about)


def _about_imu(imu: ImuTrack) -> str:
    known = [f"IMU {imu.instance}"]
    if imu.device_id is not None:
        known.append(f"device {imu.device_id}")
    if imu.low_pass_hz is not None:
        known.append(f"low-pass {imu.low_pass_hz:g} Hz")
    if imu.interval is not None and len(imu.interval):
        known.append(f"mean over {1e3 * float(np.median(imu.interval)):.3g} ms")
    if imu.gyro_range is not None:
        known.append(f"to {np.degrees(imu.gyro_range):.0f} °/s")
    if imu.accel_range is not None:
        known.append(f"to {imu.accel_range / STANDARD_GRAVITY:.0f} g")
    if imu.bias_removed:
        known.append("the estimator's bias removed")
    return ", ".join(known)


def _about_range(finder: RangeTrack) -> str:
    unread = int(np.isnan(finder.distance).sum())
    known = (
        [_ORIENTATIONS.get(finder.orientation, f"orientation {finder.orientation}")]
        if finder.orientation is not None
        else []
    )
    if finder.least is not None and finder.most is not None:
        known.append(f"{finder.least:g} to {finder.most:g} m")
    return ", ".join([*known, *([f"{unread} without a reading"] if unread else [])])


def _about_flow(flow: FlowTrack) -> str:
    known = [f"mean over {1e3 * float(np.nanmedian(flow.interval)):.3g} ms"] if np.isfinite(flow.interval).any() else []
    return ", ".join([*known, *(["with a range finder"] if np.isfinite(flow.distance).any() else [])])


def _about_gps(gps: GpsTrack) -> str:
    fixed = np.isfinite(gps.latitude)
    known = [f"{int((~fixed).sum())} without a fix"] if not fixed.all() else []
    for sigma, what in ((gps.horizontal_sigma, "horizontal"), (gps.speed_sigma, "speed")):
        if np.isfinite(sigma).any():
            unit = "m" if what == "horizontal" else "m/s"
            known.append(f"{what} 1σ {float(np.nanmedian(sigma)):.2g} {unit}")
    if not np.isfinite(gps.velocity[:, 2]).any():
        known.append("no vertical speed")
    return ", ".join(known)
