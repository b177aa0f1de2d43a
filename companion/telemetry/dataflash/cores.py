"""The cores of ArduPilot's EKFs: the IMU that each reads, which of them flew, their biases, and the resets announced.

Since 2020 each record names its core in a column; before, the second cores have record types of their own.
Sources: ArduPilot `AP_NavEKF3.cpp` (InitialiseFilter), `AP_NavEKF3_Logging.cpp` (XKF4), `AP_NavEKF2_Logging.cpp`,
`AP_Logger.h` (LogEvent), and of 2015 `DataFlash/LogFile.cpp` (Log_Write_EKF).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.logs import Records
from companion.mavlink import Index
from companion.model import Array, BiasTrack, DataError, EstimatorReset, ResetKind, SensorInUse, StatusText
from companion.telemetry import events
from companion.telemetry.samples import bias_track, commonest, finite_rows, in_use

_EKFS = {"XK": (3, "EK3_IMU_MASK"), "NK": (2, "EK2_IMU_MASK"), "EK": (1, "")}
"""What the names of an EKF's records begin with → its number in AHRS_EKF_TYPE, and the parameter with its IMUs."""

_SECOND = {"F1": "F6", "F2": "F7", "F3": "F8", "F4": "F9"}  # of the second core, before 2020
_TARGET_DT = 0.01  # s, of an EKF update: EKF_TARGET_DT; XKT has the true one

NUMBERS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("XKF1", "XKF6", "NKF1", "NKF6", "EKF1"), ("PN", "PE", "PD", "VN", "VE", "VD", "GX", "GY", "GZ")),
    **dict.fromkeys(("XKF2", "XKF7"), ("AX", "AY", "AZ")),
    **dict.fromkeys(("NKF2", "NKF7"), ("AZbias",)),
    **dict.fromkeys(("XKQ", "NKQ", "XKQ1", "XKQ2", "NKQ1", "NKQ2"), ("Q1", "Q2", "Q3", "Q4")),
    "XKV1": ("V10", "V11"),
    "XKV2": ("V12", "V13", "V14", "V15"),
    "XKT": ("EKFMin", "EKFMax"),
}
"""Columns that these records must have."""


@dataclass(frozen=True, slots=True, eq=False)
class Ekf:
    """The EKF that flew, with all that the log has, and the core of it that flew for most of the log."""

    records: Mapping[str, Records]
    parameters: Mapping[str, float]
    prefix: str  # of its records: "XK", "NK" or "EK"
    t: Array  # (N,) s, when the log tells which core is primary (XKF4.PI); none where it does not ...
    primary: Index  # (N,) ... and which that is
    core: int

    @property
    def name(self) -> str:
        """ "EKF3"."""
        return f"EKF{_EKFS[self.prefix][0]}"

    def of_cores(self, name: str) -> dict[int, Records]:
        """Its records of each core. name: of the first core, without the prefix ("F1", "Q")."""
        records, first = self.records, self.prefix + name
        if first in records and records[first].instances:
            one = records[first]
            return {int(core): one.instance(core) for core in one.instances}
        names = (f"{first}1", f"{first}2") if name == "Q" else (first, self.prefix + _SECOND.get(name, ""))
        return {core: records[own] for core, own in enumerate(names) if own in records}

    def imu_of(self, core: int) -> int | None:
        """The IMU of a core; None for one that the mask has not, and for the first EKF, which mixes two IMUs."""
        mask = _EKFS[self.prefix][1]
        return events.imu_of_core(core, self.parameters.get(mask, np.nan)) if mask else None

    def sensors_of(self, core: int) -> dict[str, SensorInUse]:
        """Which receiver, compass, barometer and airspeed sensor a core used, from each change on (XKFS)."""
        one = self.of_cores("FS").get(core)
        if one is None:
            return {}
        used = {
            kind: in_use(f"{one.name}.{column}", one.t, one[column].astype(np.int64))
            for kind, column in _SELECTION.items()
            if one.layout.has_numbers(column)
        }
        return {kind: sensor for kind, sensor in used.items() if sensor is not None}


_SELECTION = {"GPS": "GI", "compass": "MI", "barometer": "BI", "airspeed": "AI"}
"""Kind of sensor → the column of XKFS with the number of the one that a core uses."""


def flew(records: Mapping[str, Records], parameters: Mapping[str, float]) -> Ekf:
    """By AHRS_EKF_TYPE where several were running, and XKF4.PI."""
    kind = parameters.get("AHRS_EKF_TYPE")
    present = [prefix for prefix in _EKFS if f"{prefix}F1" in records] or ["XK"]
    prefix = next((prefix for prefix in present if _EKFS[prefix][0] == kind), present[0])
    t, primary = np.empty(0), np.empty(0, np.int64)
    if (status := records.get(f"{prefix}F4")) is not None and status.layout.has_numbers("PI"):
        t, primary = status.t, status["PI"].astype(np.int64)
    return Ekf(records, parameters, prefix, t, primary, commonest(primary))


def reference_core(ekf: Ekf, chosen: int | None, notes: list[str]) -> int:
    """The EKF core to compare with, noted when that is not simply the one that always flew.

    Raises DataError for a core that the log has not.
    """
    if len(cores := np.unique(ekf.primary).tolist()) > 1:
        notes.append(f"the EKF changed its primary core ({cores}): core {ekf.core} is the reference")
    if chosen is None or chosen == ekf.core:
        return ekf.core
    known = sorted({core for name in ("Q", "F1") for core in ekf.of_cores(name)})
    if chosen not in known:
        have = ", ".join(map(str, known)) or "one without a number"
        raise DataError(f"the log has no EKF core {chosen}. It has: {have}; the one that flew is {ekf.core}.")
    notes.append(f"EKF core {chosen} is the reference, as asked; the one that flew is {ekf.core}")
    return chosen


def imu_in_use(ekf: Ekf) -> SensorInUse | None:
    """The IMU of the primary core, from each change on."""
    imus = {core: ekf.imu_of(core) for core in np.unique(ekf.primary).tolist() if core >= 0}
    known = {core: imu for core, imu in imus.items() if imu is not None}
    instance = np.array([known.get(core, -1) for core in ekf.primary.tolist()], np.int64)
    return in_use(f"{ekf.prefix}F4.PI", ekf.t, instance, instance >= 0)


def lane_in_use(ekf: Ekf) -> SensorInUse | None:
    """The core that flew, from each change on."""
    return in_use(f"{ekf.prefix}F4.PI", ekf.t, ekf.primary, ekf.primary >= 0)


def bias_tracks(ekf: Ekf) -> tuple[BiasTrack, ...]:
    """What each core believes, that of the core that flew first, in the frame of the logged IMUs.

    Gyro biases are logged in 0.01 deg/s, accelerometer biases in 0.01 m/s², cut towards zero. EKF2 knows the z axis of
    the accelerometer only; its predecessor has one for each IMU, in columns that changed their names.
    """
    estimates, others = (ekf.of_cores(name) for name in ("F1", "F2"))
    tracks = (
        _bias_track(ekf, one, others.get(core), core)
        for core, one in sorted(estimates.items(), key=lambda item: (item[0] != ekf.core, item[0]))
    )
    return tuple(track for track in tracks if len(track))


def _bias_track(ekf: Ekf, estimate: Records, other: Records | None, core: int) -> BiasTrack:
    t = estimate.t
    gyro = np.radians(estimate.columns("GX", "GY", "GZ"))
    accel = np.full((len(t), 3), np.nan)
    if other is not None and len(other) and other.name != "EKF2":
        for i, axis in enumerate("XYZ"):
            if other.layout.has_numbers(f"A{axis}"):
                accel[:, i] = np.interp(t, other.t, other[f"A{axis}"])
        if other.layout.has_numbers("AZbias"):
            accel[:, 2] = np.interp(t, other.t, other["AZbias"] * 0.01)
    columns, good = (gyro, accel, *_sigmas(ekf, core, t)), np.isfinite(t) & finite_rows(gyro)
    return bias_track(f"{estimate.name}[{core}]", t, columns, good, core, ekf.imu_of(core))


def _sigmas(ekf: Ekf, core: int, t: Array) -> tuple[Array, Array]:
    """1σ of both biases (N, 3): XKV1 and XKV2 of the core that flies, about twice a second.

    They are variances of a delta angle and a delta velocity over one update of the EKF, whose length XKT has.
    """
    gyro, accel = np.full((len(t), 3), np.nan), np.full((len(t), 3), np.nan)
    first, second = (ekf.of_cores(own).get(core) for own in ("V1", "V2"))
    if ekf.prefix != "XK" or first is None or second is None:
        return gyro, accel
    timing = ekf.of_cores("T").get(core)
    dt = _TARGET_DT if timing is None else float(np.median(0.5 * (timing["EKFMin"] + timing["EKFMax"])))
    if not 1e-3 < dt < 0.1:
        dt = _TARGET_DT
    columns = [(first, "V10"), (first, "V11"), (second, "V12"), *((second, f"V{i}") for i in (13, 14, 15))]
    for i, (one, column) in enumerate(columns):
        sigma = np.sqrt(one[column].astype(np.float64)) / dt
        (gyro if i < 3 else accel)[:, i % 3] = np.interp(t, one.t, sigma, left=np.nan, right=np.nan)
    return gyro, accel


_EVENTS: Mapping[int, tuple[ResetKind, str]] = {60: ("height", "EKF height reset"), 62: ("heading", "EKF yaw reset")}
_SAME_S = 0.5  # an event and a text of the same kind within it are one reset


def resets(ekf: Ekf, texts: Sequence[StatusText]) -> tuple[EstimatorReset, ...]:
    """All that are announced of the EKF that flew, in order of time, each once."""
    switches = events.lane_changes(ekf.t, ekf.primary, "the EKF's primary core is {core}, and was {before}")
    announced = [*_by_text(ekf, texts), *_by_event(ekf), *_by_offset(ekf), *switches]
    kept: list[EstimatorReset] = []
    for one in sorted(announced, key=lambda reset: reset.t):
        again = any(
            one.kind == other.kind
            and one.t - other.t < _SAME_S
            and (one.core is None or other.core in (None, one.core))
            for other in kept[-8:]
        )
        if not again:
            kept.append(one)
    return tuple(kept)


def _by_text(ekf: Ekf, texts: Sequence[StatusText]) -> Iterator[EstimatorReset]:
    """Texts name the IMU of a core."""
    cores = {imu: core for core in range(8) if (imu := ekf.imu_of(core)) is not None}
    for reset in events.text_resets(texts):
        core = reset.core
        yield reset if core is None or reset.kind == "lane" else replace(reset, core=cores.get(core, core))


def _by_event(ekf: Ekf) -> Iterator[EstimatorReset]:
    for t, number in events.numbers(ekf.records, "EV", "Id"):
        if number in _EVENTS:
            yield EstimatorReset(t, *_EVENTS[number])


def _by_offset(ekf: Ekf) -> Iterator[EstimatorReset]:
    """XKF4.OFN and OFE: by how much the position was reset last, m."""
    for core, one in ekf.of_cores("F4").items():
        if not one.layout.has_numbers("OFN", "OFE") or len(one) < 2:
            continue
        offset = one.columns("OFN", "OFE")
        for i in (np.flatnonzero(np.diff(offset, axis=0).any(axis=1)) + 1).tolist():
            if np.isfinite(offset[i]).all():
                size = float(np.linalg.norm(offset[i]))
                yield EstimatorReset(float(one.t[i]), "position", f"EKF position reset of {size:.2f} m", core)
