"""The place on Earth of an on-board log, before and after its estimator knows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import companion as c
from companion.model import Origin
from tests.dataflash_writer import write_dataflash

NAN = float("nan")
SEA = 584.0  # m, the height of the field
TYPES = {
    "POS": ("QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "GPS": ("QBBLLf", "TimeUS,I,Status,Lat,Lng,Alt"),
    "XKF1": ("QBfffffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "ATT": ("Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
}
HERE = (-353632621, 1491652370)  # 1e-7 °
Row = tuple[str, tuple[object, ...]]


def when(row: Row) -> int:
    """µs."""
    us = row[1][0]
    assert isinstance(us, int)
    return us


def origin(path: Path, rows: list[Row]) -> Origin:
    """Of a vehicle that stands level at the origin of its estimate, and logs these rows too."""
    for i in range(100):
        us = 1_000_000 + 100_000 * i
        rows += [("ATT", (us, *[0.0] * 6)), ("XKF1", (us, 0, *[0.0] * 9))]
    found = c.open_log(write_dataflash(path / "log.bin", TYPES, sorted(rows, key=when)))[0].origin
    assert found is not None
    return found


def test_a_height_above_the_start_is_none_above_the_sea(tmp_path: Path) -> None:
    """As ArduPilot writes POS: without an origin; by DCM beside one; in the instant in which it is set; and then."""
    heights = [(0.1, NAN), (0.1, 0.1 - SEA), (0.1, 0.1), (SEA, 0.0), (SEA, 0.0)]
    rows: list[Row] = [
        ("POS", (2_000_000 + 1_000_000 * i, *HERE, alt, 0.0, above)) for i, (alt, above) in enumerate(heights)
    ]
    found = origin(tmp_path, rows)
    assert (found.height, found.t) == (SEA, 5.0)


def test_where_pos_never_tells_the_height_the_fix_does(tmp_path: Path) -> None:
    """The first one: without a fix the receiver told a place far away."""
    rows: list[Row] = [
        ("POS", (2_000_000, *HERE, 0.1, 0.0, NAN)),
        ("GPS", (3_000_000, 0, 1, -349722477, 1475159052, 577.0)),
        ("GPS", (4_000_000, 0, 3, *HERE, SEA)),
    ]
    found = origin(tmp_path, rows)
    assert (found.height, found.t) == (SEA, 4.0)
    assert np.degrees(found.latitude) == HERE[0] * 1e-7
