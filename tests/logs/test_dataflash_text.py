"""On-board logs in text: what pymavlink's DFReader_text reads, and the flight of the .bin that they were made of."""

from __future__ import annotations

import lzma
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary, DFReader_text

import companion as c
from companion.app.recording import read_recording
from companion.logs import log_format, looks_like_a_log, read_dataflash_text
from companion.model import InputError

TAKEOFF = Path(__file__).parent.parent / "data" / "copter-takeoff.bin.xz"
HEAD = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 130, 35, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ
FMT, 131, 35, GPS, QBBLLe, TimeUS,Status,NSats,Lat,Lng,Alt
FMT, 132, 35, MODE, QMBB, TimeUS,Mode,ModeNum,Rsn
FMT, 133, 35, MSG, QZ, TimeUS,Message
"""
ROWS = """IMU, 1000000, 0, 0.1, -0.2, 0.3, 0.0, 0.0, -9.81
GPS, 1000000, 3, 12, -35.3632621, 149.1652374, 584.09
MODE, 1000000, Stabilize, 0, 1
MSG, 1000000, ArduCopter V4.1.0 (1, 2, x)
IMU, 1020000, 0, nan, -0.2, 0.3, 0.0, 0.0, -9.82
IMU, 1040000, 0, 0.1, -0.2, 0.3, 0.0, 0.0, -9.83
"""


def write_text(binary: Path, text: Path, records: int) -> int:
    """The first records as text; returns how many bytes of the .bin they are.

    As MAVProxy's and Mission Planner's converters do: the values as their formats mean them.

    FILE is left out: it holds bytes, among them ends of lines.
    """
    reader = DFReader_binary(str(binary))
    with text.open("w", encoding="ascii", errors="replace") as file:
        for _ in range(records):
            message = reader.recv_msg()
            if message.get_type() == "FILE":
                continue
            values = (getattr(message, name) for name in message.fmt.columns)
            words = (v.decode("latin-1") if isinstance(v, bytes) else str(v) for v in values)
            file.write(", ".join([message.get_type(), *words]) + "\n")
    reader.close()
    return int(reader.offset)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The first records of a flight, as .bin and as text."""
    folder = tmp_path_factory.mktemp("text")
    binary = folder / "log.bin"
    data = lzma.decompress(TAKEOFF.read_bytes())
    binary.write_bytes(data)
    binary.write_bytes(data[: write_text(binary, folder / "flight.log", 6000)])
    return binary, folder / "flight.log"


def test_columns_are_those_of_pymavlink(pair: tuple[Path, Path]) -> None:
    ours = read_dataflash_text(pair[1])
    theirs: dict[str, list[Any]] = {}
    reader = DFReader_text(str(pair[1]))
    while (message := reader.recv_msg()) is not None:
        theirs.setdefault(message.get_type(), []).append(message)
    reader.data_map.close()
    reader.filehandle.close()
    theirs.pop("FMT")
    assert theirs.keys() == ours.messages.keys()
    for name, records in ours.messages.items():
        if name == "UNIT":  # of which pymavlink drops the one with an empty label
            continue
        assert len(records) == len(theirs[name])
        for field in records.layout.fields:
            if records.layout.kind(field) in "iuf":
                read = np.array([getattr(m, field) for m in theirs[name]], np.float64)  # of a mode it has the text
                np.testing.assert_array_equal(records[field], read)


def test_the_flight_is_that_of_the_binary_log(pair: tuple[Path, Path]) -> None:
    """Every track, series and parameter. Single precision is written with all its digits."""
    assert log_format(pair[1]) == "dataflash text"
    assert looks_like_a_log(pair[1])
    (text,) = c.open_log(pair[1])
    (whole,) = c.open_log(pair[0])
    for name in ("imus", "gps", "compasses", "barometers", "biases", "control", "actuators", "truth", "series"):
        compare(getattr(text, name), getattr(whole, name), name)
    assert text.parameters == pytest.approx(whole.parameters, rel=1e-6)
    assert text.imus
    assert text.gps
    assert (text.vehicle, text.on_board) == (whole.vehicle, True)


def compare(one: Any, other: Any, where: str) -> None:
    """Whatever it is, the same."""
    if isinstance(one, np.ndarray):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9, err_msg=where)
    elif is_dataclass(one):
        for part in fields(one):
            compare(getattr(one, part.name), getattr(other, part.name), f"{where}.{part.name}")
    elif hasattr(one, "keys"):
        assert one.keys() == other.keys()
        for key in one:
            compare(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, Sequence) and not isinstance(one, str):
        for i, (mine, theirs) in enumerate(zip(one, other, strict=True)):
            compare(mine, theirs, f"{where}[{i}]")
    else:
        assert one == other, where


def test_names_of_modes_commas_in_texts_and_banners(tmp_path: Path) -> None:
    """As Mission Planner writes them; a log from the days of the terminal begins with what that said."""
    path = tmp_path / "flight.log"
    path.write_text("\nArduCopter V3.1.5\nFree RAM: 1331\n" + HEAD + ROWS)
    log = read_dataflash_text(path)
    assert {name: len(records) for name, records in log.messages.items()} == {"IMU": 3, "GPS": 1, "MODE": 1, "MSG": 1}
    assert log.messages["MODE"]["Mode"].tolist() == [b"Stabilize"]
    assert log.messages["MSG"]["Message"].tolist() == [b"ArduCopter V4.1.0 (1, 2, x)"]
    assert log.messages["GPS"]["Lat"].tolist() == [-35.3632621]
    (flight,) = c.open_log(path)
    assert len(flight.imu()) == 2  # nan is no reading
    assert [event.text for event in flight.events if event.kind == "mode"] == ["STABILIZE"]
    assert flight.vehicle.firmware == "4.1.0"


@pytest.mark.parametrize(
    ("line", "left"),
    [
        ("IMU, 1060000, 0, 0.1, -0.2", 3),  # cut off
        ("IMU, 1060000, 0, 0.1, -0.2, zero, 0.0, 0.0, -9.81", 3),
        ("IMU, 1060000, 300, 0.1, -0.2, 0.3, 0.0, 0.0, -9.81", 3),  # no instance of a byte
        ("IMU, -5, 0, 0.1, -0.2, 0.3, 0.0, 0.0, -9.81", 3),
        ("IMU, 18446744073709551615, 0, 0.1, -0.2, 0.3, 0.0, 0.0, -9.81", 3),  # as a double no number of 64 bits
        ("IMU,1060000,0,0.1,-0.2,0.3,0,0,-9.81", 4),
        ("\x00\xff, IMU", 3),
        ("OTHER, 1, 2", 3),
    ],
)
def test_a_damaged_line_costs_itself_alone(tmp_path: Path, line: str, left: int) -> None:
    path = tmp_path / "damaged.log"
    path.write_text(HEAD + ROWS + line + "\n", encoding="latin-1")
    log = read_dataflash_text(path)
    assert len(log.messages["IMU"]) == left
    assert (log.skipped_bytes > 0) == (left == 3)


def test_a_text_without_records_says_so(tmp_path: Path) -> None:
    path = tmp_path / "head.log"
    path.write_text(HEAD.splitlines()[0] + "\n")
    with pytest.raises(InputError, match=r"head\.log"):
        c.open_log(path)


@pytest.mark.parametrize("text", ["FMT of the day\n", "a, b\n1, 2\n", "# FMT, no log\n"])
def test_another_text_is_no_log(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.log"
    path.write_text(text * 100)
    assert log_format(path) == "mavlink"
    assert not looks_like_a_log(path)


OF_2013 = """
ArduCopter V3.0.1 (5c6503e2)
FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format
FMT, 130, 35, GPS, BIBcLLeeEe, Status,Time,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs
FMT, 131, 27, IMU, ffffff, GyrX,GyrY,GyrZ,AccX,AccY,AccZ
FMT, 1, 17, ATT, cccccCC, RollIn,Roll,PitchIn,Pitch,YawIn,Yaw,NavYaw
ATT, 0.00, 0.47, 0.00, -8.53, 0.00, 111.24, 111.24
ATT, 0.00, 0.47, 0.00, -8.54, 0.00, 111.26, 111.26
GPS, 3, 302400000, 9, 1.20, 35.0, 149.0, 0.1, 584.0, 0.1, 0.0
"""


@pytest.mark.parametrize(("more", "without"), [("", True), ("IMU, 0.1, 0, 0, 0, 0, -9.8\n", False)])
def test_a_log_whose_records_have_no_times_says_so(tmp_path: Path, more: str, *, without: bool) -> None:
    """And not that there is no vehicle."""
    path = tmp_path / "old.log"
    path.write_text(OF_2013 + more)
    recording = read_recording(path)
    assert recording.flights == ()
    assert recording.no_flight.startswith("it has no IMU (LOG_BITMASK), and its records have no times") == without
    assert "its records have no times" in recording.no_flight
    assert "ATT (2)" in recording.no_flight
    assert "no vehicle" not in recording.no_flight


def test_a_log_without_an_imu_says_so(tmp_path: Path) -> None:
    path = tmp_path / "noimu.log"
    declared = "FMT, 1, 17, ATT, Icccccc, TimeMS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw\n"
    rows = "".join(f"ATT, {1000 + 100 * i}, 0.00, 0.47, 0.00, -8.53, 0.00, 111.24\n" for i in range(30))
    path.write_text(HEAD + declared + rows)
    (flight,) = c.open_log(path)
    with pytest.raises(c.DataError, match="no IMU"):
        flight.imu()


def test_a_log_whose_records_have_no_times_has_those_of_its_gps(tmp_path: Path) -> None:
    """From its first fix on; what happened before holds then."""
    fixes = [
        f"GPS, {2 + (i > 2)}, {302400000 + 200 * i}, 9, 1.20, 35.{i:03}, 149.0, 0.1, 584.0, 5.1, 0.0" for i in range(9)
    ]
    rows = "".join(f"{fix}\nATT, 0.00, {i}.00, 0.00, 0.50, 0.00, 90.00, 90.00\n" for i, fix in enumerate(fixes))
    path = tmp_path / "old.log"
    path.write_text(OF_2013[: OF_2013.rindex("GPS,")] + "FMT, 13, 4, EV, B, Id\nEV, 10\n" + rows)
    (flight,) = c.open_log(path)
    (gps,) = flight.gps
    assert gps.t == pytest.approx(0.2 * np.arange(6), abs=1e-6)
    attitude = flight.require_attitude()
    assert attitude.t == pytest.approx(0.1 + 0.2 * np.arange(5), abs=0.05)
    assert [(e.kind, e.t) for e in flight.events] == [("armed", 0.0)]
    assert any("GPS" in note for note in flight.notes)
