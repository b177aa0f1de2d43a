"""Jumps that PX4's estimator announces: counters that go up where it sets a state anew, and changes of its instance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from companion.model import EstimatorReset, ResetKind
from companion.telemetry.ulog.topics import Topic, Topics, columns, sampled, seconds

_COUNTERS: tuple[tuple[str, str, ResetKind, tuple[str, ...], str], ...] = (
    ("vehicle_local_position", "xy_reset_counter", "position", ("delta_xy[0]", "delta_xy[1]"), "m"),
    ("vehicle_local_position", "z_reset_counter", "height", ("delta_z",), "m"),
    ("vehicle_local_position", "vxy_reset_counter", "velocity", ("delta_vxy[0]", "delta_vxy[1]"), "m/s"),
    ("vehicle_local_position", "vz_reset_counter", "velocity", ("delta_vz",), "m/s down"),
)
"""Topic, its counter, what it counts, the jump and its unit. Of the attitude: `_attitude_resets`."""

_SELECTOR = "estimator_selector_status"
_WRAPS = 256  # the counters are uint8
_LEVEL = 0.1  # a jump whose tilt is a smaller share of it than this is one of the heading


def estimator_resets(topics: Topics) -> tuple[EstimatorReset, ...]:
    """All of the instance that flies, in order of time: each at the first row that counts it."""
    resets = [*_attitude_resets(topics), *_lanes(topics)]
    for name, counter, kind, jump, unit in _COUNTERS:
        if name in topics:
            for t, i, times in _counted(topics[name], counter):
                size = float(np.linalg.norm(np.nan_to_num(columns(topics[name], *jump)[i])))
                resets.append(EstimatorReset(t, kind, f"{kind} reset by {size:.2f} {unit}{_often(times)}"))
    return tuple(sorted(resets, key=lambda reset: reset.t))


def _attitude_resets(topics: Topics) -> Iterator[EstimatorReset]:
    """By vehicle_attitude's quat_reset_counter; delta_q_reset is the turn in NED."""
    if "vehicle_attitude" not in topics:
        return
    topic = topics["vehicle_attitude"]
    turn = columns(topic, *(f"delta_q_reset[{k}]" for k in range(4)))
    for t, i, times in _counted(topic, "quat_reset_counter"):
        w, *axis = np.nan_to_num(turn[i])
        size = np.degrees(2.0 * np.arctan2(np.linalg.norm(axis), abs(w)))
        level = float(np.hypot(axis[0], axis[1])) <= _LEVEL * abs(axis[2])
        kind: ResetKind = "heading" if level else "attitude"
        yield EstimatorReset(t, kind, f"{kind} reset by {size:.1f}°{_often(times)}")


def _lanes(topics: Topics) -> Iterator[EstimatorReset]:
    """Where another instance of the estimator takes over."""
    if _SELECTOR not in topics or "primary_instance" not in topics[_SELECTOR]:
        return
    t, primary = seconds(topics[_SELECTOR]), np.asarray(topics[_SELECTOR]["primary_instance"]).astype(np.int64)
    for i in (np.flatnonzero(np.diff(primary)) + 1).tolist():
        core = int(primary[i])
        yield EstimatorReset(float(t[i]), "lane", f"EKF2 instance {primary[i - 1]} → {core}", core=core)


def _counted(topic: Topic, counter: str) -> Iterator[tuple[float, int, int]]:
    """(time, row, how often) of each row at which a counter went up."""
    if counter not in topic:
        return
    ups = np.mod(np.diff(np.asarray(topic[counter]).astype(np.int64)), _WRAPS)
    t = sampled(topic)
    for i in (np.flatnonzero(ups) + 1).tolist():
        yield float(t[i]), i, int(ups[i - 1])


def _often(times: int) -> str:
    return "" if times == 1 else f", the last of {times}"
