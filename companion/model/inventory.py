"""What a flight has: every sensor and every estimate in it, its rate and its gaps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from companion.model.aiding import FlowTrack, GpsTrack, RangeTrack
from companion.model.flight import Flight
from companion.model.tracks import STANDARD_GRAVITY, ImuTrack, longest_step

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


def _items(flight: Flight) -> Iterator[Item]:
    for attribute, kind, about in _TRACKS:
        held = getattr(flight, attribute)
        tracks = held.values() if isinstance(held, Mapping) else held if isinstance(held, Sequence) else (held,)
        yield from (_item(kind, one, about(one)) for one in tracks if one is not None)
    for key in flight.series:
        if (name := _SERIES.get(key.partition(":")[0])) is not None:
            yield _item(name, flight.series[key])
    if flight.truth is not None:
        yield _item("truth", flight.truth, "a simulator's: never an input")


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


def _item(kind: str, track: Any, about: str = "") -> Item:
    source, t, steps = track.source, track.t, np.diff(track.t)
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
    known = []
    if finder.orientation is not None:
        known.append(_ORIENTATIONS.get(finder.orientation, f"orientation {finder.orientation}"))
    if finder.least is not None and finder.most is not None:
        known.append(f"{finder.least:g} to {finder.most:g} m")
    return ", ".join([*known, *([f"{unread} without a reading"] if unread else [])])


def _about_flow(flow: FlowTrack) -> str:
    known = [f"mean over {1e3 * float(np.nanmedian(flow.interval)):.3g} ms"] if np.isfinite(flow.interval).any() else []
    return ", ".join([*known, *(["with a range finder"] if np.isfinite(flow.distance).any() else [])])


def _about_gps(gps: GpsTrack) -> str:
    fixed = np.isfinite(gps.latitude)
    known = [f"{int((~fixed).sum())} without a fix"] if not fixed.all() else []
    for sigma, what, unit in ((gps.horizontal_sigma, "horizontal", "m"), (gps.speed_sigma, "speed", "m/s")):
        if np.isfinite(sigma).any():
            known.append(f"{what} 1σ {float(np.nanmedian(sigma)):.2g} {unit}")
    if not np.isfinite(gps.velocity[:, 2]).any():
        known.append("no vertical speed")
    return ", ".join(known)


_TRACKS: Sequence[tuple[str, str, Callable[[Any], str]]] = (
    ("imus", "IMU", _about_imu),
    ("gps", "GPS", _about_gps),
    ("compasses", "compass", lambda one: "" if one.calibrated else "not calibrated"),
    ("barometers", "barometer", lambda _: ""),
    ("airspeeds", "airspeed", lambda one: "" if np.isfinite(one.airspeed).any() else "differential pressure alone"),
    ("ranges", "range finder", _about_range),
    ("flows", "optical flow", _about_flow),
    ("attitude", "attitude", lambda _: ""),
    ("position", "position", lambda _: ""),
    ("biases", "IMU bias", lambda one: "" if one.imu_instance is None else f"of IMU {one.imu_instance}"),
    ("control", "desired attitude", lambda _: ""),
    ("actuators", "motors and servos", lambda one: f"{np.isfinite(one.output).any(axis=0).sum()} outputs"),
)
"""What a flight has, sensors first: its attribute, what it is called here, and what else is known of it."""
