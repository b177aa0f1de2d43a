"""On-board logs: every record and every value as pymavlink's DFReader has them, and what damage costs."""

from __future__ import annotations

import gzip
import struct
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.DFReader import DFReader_binary

from companion.app.recording import open_log
from companion.logs import Records, read_dataflash
from companion.model import InputError
from tests.dataflash_writer import write_dataflash
from tests.recordings import alike, recording

pytestmark = pytest.mark.slow

SMALL = "dataflash/sitl__copter-imu1-fail.BIN"
LOGS = [
    SMALL,
    "dataflash/sitl__copter-demo.BIN",
    *alike("dataflash/sitl__copter-hover-nodrift.BIN"),
    "dataflash/public__clydemcqueen__ardusub_log_tools__small.BIN",
]


def read_with_pymavlink(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = defaultdict(list)
    reader: Any = DFReader_binary(str(path))
    while (message := reader.recv_msg()) is not None:
        found[message.get_type()].append(message)
    reader.close()
    return found


def text(value: bytes) -> str:
    return value.partition(b"\0")[0].decode("latin-1")


@pytest.mark.parametrize("name", LOGS)
def test_every_record_and_value_is_what_dfreader_reads(name: str) -> None:
    path = recording(name)
    log = read_dataflash(path)
    theirs = read_with_pymavlink(path)
    assert {key: len(records) for key, records in log.messages.items()} == {k: len(v) for k, v in theirs.items()}
    assert not log.undecoded
    for key, records in log.messages.items():
        for field in records.layout.fields:
            column = records[field]
            values = [getattr(message, field) for message in theirs[key]]
            if column.dtype.kind == "S":
                if key != "FILE":  # its text is the content of files, which DFReader leaves as bytes
                    assert [text(v) for v in column.tolist()] == values
            elif column.ndim == 2:
                assert column.tolist() == [list(value) for value in values]
            else:
                np.testing.assert_array_equal(column, np.array(values, column.dtype), err_msg=f"{key}.{field}")


def test_imu_of_a_fast_log_is_dfreaders() -> None:
    path = recording("dataflash/sitl__copter-demo.BIN")
    imu = read_dataflash(path, names={"IMU"}).messages["IMU"]
    reader: Any = DFReader_binary(str(path))
    theirs = []
    while (message := reader.recv_match(type="IMU")) is not None:
        theirs.append([message.TimeUS, message.I, message.GyrX, message.GyrY, message.GyrZ, message.AccZ])
    reader.close()
    ours = np.stack([imu[f].astype(np.float64) for f in ("TimeUS", "I", "GyrX", "GyrY", "GyrZ", "AccZ")], axis=1)
    np.testing.assert_array_equal(ours, np.array(theirs))


def test_units_and_multipliers_are_the_logs_own() -> None:
    log = read_dataflash(recording(SMALL))
    imu, gps = log.messages["IMU"], log.messages["GPS"]
    assert {imu.layout.units[f] for f in ("GyrX", "GyrY", "GyrZ")} == {"rad/s"}
    assert {imu.layout.units[f] for f in ("AccX", "AccY", "AccZ")} == {"m/s/s"}
    assert imu.layout.units["TimeUS"] == "s"
    np.testing.assert_allclose(imu.in_unit("TimeUS"), imu["TimeUS"] / 1e6, rtol=1e-15)
    assert gps.layout.units["Lat"] == "deglatitude"
    np.testing.assert_array_equal(gps.in_unit("Lat"), gps["Lat"])  # divided once, not twice
    assert abs(float(np.median(gps["Lat"])) + 35.363) < 0.01


def test_instances_are_told_apart() -> None:
    messages = read_dataflash(recording(SMALL)).messages
    imu = messages["IMU"]
    assert (imu.layout.instance_field, imu.instances) == ("I", (0, 1))
    assert (messages["XKF1"].layout.instance_field, messages["XKF1"].instances) == ("C", (0, 1))
    assert len(imu.instance(0)) + len(imu.instance(1)) == len(imu)
    assert set(imu.instance(1)["I"].tolist()) == {1}
    assert (np.diff(imu.instance(1)["TimeUS"].astype(np.int64)) > 0).all()
    attitude = messages["ATT"]
    assert attitude.instances == ()
    assert attitude.instance(0) is attitude


def test_bytes_add_up_and_offsets_are_heads() -> None:
    path = recording(SMALL)
    log = read_dataflash(path)
    data = path.read_bytes()
    total = 0
    for records in log.messages.values():
        total += len(records) * (3 + records.layout.dtype.itemsize)
        for offset in records.offset[:20].tolist():
            assert data[offset : offset + 3] == bytes([0xA3, 0x95, records.layout.type])
    assert total + log.skipped_bytes == log.size_bytes == len(data)
    assert log.frames == sum(len(records) for records in log.messages.values())


def test_only_the_rows_asked_for_are_read() -> None:
    log = read_dataflash(recording(SMALL), names={"IMU"})
    assert len(log.messages["IMU"]["GyrX"]) == len(log.messages["IMU"])
    with pytest.raises(KeyError, match="names"):
        log.messages["ATT"]["Roll"]
    with pytest.raises(KeyError, match="no field"):
        log.messages["IMU"]["Gyro"]


def record(number: int, layout: str, *values: Any) -> bytes:
    return bytes([0xA3, 0x95, number]) + struct.pack("<" + layout, *values)


OF_UNITS = [
    (128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"),
    (1, 3 + 1 + 64, b"UNIT", b"bZ", b"Id,Label"),
    (2, 3 + 1 + 8, b"MULT", b"bd", b"Id,Mult"),
    (3, 3 + 1 + 32, b"FMTU", b"BNN", b"FmtType,UnitIds,MultIds"),
]


def test_a_type_that_is_not_asked_for_has_its_times_wherever_they_stand(tmp_path: Path) -> None:
    types = {"ABC": ("BQf", "X,TimeUS,Y"), "IMU": ("Qf", "TimeUS,GyrX")}
    rows: list[tuple[str, tuple[object, ...]]] = [
        row for i in range(50) for row in (("ABC", (7, 1000 * i, 0.5)), ("IMU", (1000 * i, 0.1)))
    ]
    log = write_dataflash(tmp_path / "log.bin", types, rows)
    other = read_dataflash(log, names=("IMU",)).messages["ABC"]
    np.testing.assert_allclose(other.t, 1e-3 * np.arange(50))
    np.testing.assert_allclose(other.select(slice(3, 5)).t, [3e-3, 4e-3])
    assert len(open_log(log)) == 1


def test_every_format_letter_and_what_the_log_says_of_units(tmp_path: Path) -> None:
    declared = [
        *OF_UNITS,
        (4, 3 + 121, b"ALL", b"QBcCeELafdgiIqbM", b"T,I,c,C,e,E,L,a,f,d,g,i,I2,q,b,M"),
        (5, 3 + 4, b"BAD", b"B?", b"A,B"),
        (6, 3 + 2, b"ODD", b"BB", b"A,"),  # a column without a name
    ]
    data = b"".join(record(128, "BB4s16s64s", *fields) for fields in declared)
    data += record(1, "b64s", ord("s"), b"s") + record(1, "b64s", ord("#"), b"instance") + record(1, "b64s", 68, b"deg")
    data += record(2, "bd", ord("F"), 1e-6) + record(2, "bd", ord("-"), 0.0) + record(2, "bd", ord("G"), 1e-7)
    data += record(3, "B16s16s", 4, b"s#----D", b"F-----G") + record(3, "B16s16s", 6, b"-#", b"--")
    values = (7_000_000, 1, -150, 250, -1, 3, -353_632_621, *range(32), 0.5, 0.1, 2.0, -3, 4, -5, -6, 200)
    data += record(4, "QBhHiIi32hfdeiIqbB", *values) + record(5, "BBH", 1, 2, 3) + record(6, "BB", 1, 2) + bytes(9)
    path = tmp_path / "made.bin"
    path.write_bytes(data)
    log = read_dataflash(path)
    every = log.messages["ALL"]
    assert [every[field][0] for field in "cCeELfdg"] == [-1.5, 2.5, -0.01, 0.03, -35.3632621, 0.5, 0.1, 2.0]
    assert [every[field][0] for field in ("i", "I2", "q", "b", "M")] == [-3, 4, -5, -6, 200]
    assert every["a"].tolist() == [list(range(32))]
    assert every.in_unit("T").tolist() == [7.0]
    assert every.in_unit("L").tolist() == [-35.3632621]
    assert every.layout.units == {"T": "s", "I": "instance", "L": "deg"}
    assert (every.layout.instance_field, every.instances) == ("I", (1,))
    assert log.undecoded == {"BAD": 1, "ODD": 1}
    assert log.skipped_bytes == 9


def test_a_log_that_declares_nothing_has_no_messages(tmp_path: Path) -> None:
    path = tmp_path / "declares-itself.bin"
    path.write_bytes(record(128, "BB4s16s64s", *OF_UNITS[0]) + bytes(7))
    log = read_dataflash(path)
    assert set(log.messages) <= {"FMT"}
    assert log.skipped_bytes == 7


OLD = [
    *OF_UNITS,
    (4, 3 + 13, b"IMU", b"QBf", b"TimeUS,I,GyrX"),
    (5, 3 + 12, b"PIDR", b"Qf", b"TimeUS,I"),
]


def test_a_log_that_says_nothing_of_units_has_its_times_and_instances(tmp_path: Path) -> None:
    """FMTU is of 2018, and one flipped bit loses that of the IMU. TimeUS is µs by its name."""
    data = b"".join(record(128, "BB4s16s64s", *fields) for fields in OLD)
    for i in range(4):
        data += record(4, "QBf", 1_000_000 * i, i % 2, 0.5) + record(5, "Qf", 1_000_000 * i, 0.25)
    (tmp_path / "old.bin").write_bytes(data)
    log = read_dataflash(tmp_path / "old.bin")
    assert log.messages["IMU"].in_unit("TimeUS").tolist() == [0, 1, 2, 3]
    assert log.messages["IMU"].instances == (0, 1)
    assert log.messages["IMU"].instance(1).in_unit("TimeUS").tolist() == [1, 3]
    assert log.messages["PIDR"].instances == ()  # its I is the integral of a controller


@pytest.mark.parametrize(
    ("said", "damaged"),
    [
        (b"Id,Label", b"Ie,Label"),
        (b"Id,Mult", b"Id,Mul4"),
        (b"FmtType,U", b"FmtType,V"),
        (b"bZ", b"ZZ"),
        (b"bd", b"bQ"),
    ],
)
def test_damaged_declarations_of_units_cost_the_units(tmp_path: Path, said: bytes, damaged: bytes) -> None:
    data = b"".join(record(128, "BB4s16s64s", *fields) for fields in OLD).replace(said, damaged)
    data += record(1, "b64s", -5, b"s") + record(2, "bd", -7, 1e-6) + record(3, "B16s16s", 4, b"s#-", b"F--")
    data += record(4, "QBf", 2_000_000, 1, 0.5) * 2
    (tmp_path / "damaged.bin").write_bytes(data)
    imu = read_dataflash(tmp_path / "damaged.bin").messages["IMU"]
    assert imu.in_unit("TimeUS").tolist() == [2.0, 2.0]
    assert imu.instances == (1,)


def same_rows(one: Records, other: Records) -> bool:
    return one.rows.tobytes() == other.rows.tobytes()


def test_compressed_and_joined_logs(tmp_path: Path) -> None:
    path = recording(SMALL)
    data, log = path.read_bytes(), read_dataflash(path)
    (tmp_path / "log.gz").write_bytes(gzip.compress(data, 1))
    packed = read_dataflash(tmp_path / "log.gz")
    assert all(same_rows(packed.messages[name], records) for name, records in log.messages.items())
    (tmp_path / "twice.bin").write_bytes(data + data)
    assert read_dataflash(tmp_path / "twice.bin").frames == 2 * log.frames


def test_damage_costs_the_records_it_touches(tmp_path: Path) -> None:
    """Heads overwritten at 80 places: those records are lost, and no others (each has an intact neighbour)."""
    path = recording(SMALL)
    log = read_dataflash(path)
    data = bytearray(path.read_bytes())
    imu = log.messages["IMU"]
    hit = np.arange(3, len(imu), 7)[:80]
    for offset in imu.offset[hit].tolist():
        data[offset : offset + 2] = b"\0\0"
    (tmp_path / "damaged.bin").write_bytes(data)
    damaged = read_dataflash(tmp_path / "damaged.bin")
    kept = np.setdiff1d(imu.offset, imu.offset[hit])
    np.testing.assert_array_equal(damaged.messages["IMU"].offset, kept)
    assert damaged.skipped_bytes == log.skipped_bytes + 80 * (3 + imu.layout.dtype.itemsize)
    others = {name: len(records) for name, records in log.messages.items() if name != "IMU"}
    assert others == {name: len(records) for name, records in damaged.messages.items() if name != "IMU"}


@pytest.mark.parametrize(
    "junk", [bytes(5000), b"\xff" * 5000, np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes()]
)
def test_junk_in_the_middle_and_at_the_end(tmp_path: Path, junk: bytes) -> None:
    path = recording(SMALL)
    data, log = path.read_bytes(), read_dataflash(path)
    middle = int(log.messages["IMU"].offset[300])
    (tmp_path / "junk.bin").write_bytes(data[:middle] + junk + data[middle:] + junk)
    damaged = read_dataflash(tmp_path / "junk.bin")
    assert all(same_rows(damaged.messages[name], records) for name, records in log.messages.items())
    assert damaged.skipped_bytes == log.skipped_bytes + 2 * len(junk)


def test_cut_at_every_byte_of_the_last_record(tmp_path: Path) -> None:
    path = recording(SMALL)
    data, log = path.read_bytes(), read_dataflash(path)
    counts = Counter({name: len(records) for name, records in log.messages.items()})
    last = max(log.messages.values(), key=lambda records: int(records.offset[-1]))
    for end in range(int(last.offset[-1]), len(data)):
        (tmp_path / "cut.bin").write_bytes(data[:end])
        cut = read_dataflash(tmp_path / "cut.bin")
        assert counts - Counter({n: len(r) for n, r in cut.messages.items()}) == {last.name: 1}


def test_random_bytes_behind_the_magic_never_raise_anything_else(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "noise.bin"
    for size in (0, 1, 2, 50, 90, 1000, 100_000):
        noise = rng.choice(np.array([0xA3, 0x95, 0x80, 3, 0, 65], np.uint8), size).tobytes()
        path.write_bytes(b"\xa3\x95" + noise)
        try:
            log = read_dataflash(path)
        except InputError:
            continue
        assert log.skipped_bytes <= log.size_bytes


def test_other_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(b"ULog\x01\x12\x35" + bytes(100))
    with pytest.raises(InputError, match=r"55 4C 6F 67"):
        read_dataflash(path)
    path.write_bytes(b"\xa3\x95\x80\x80")
    with pytest.raises(InputError, match="no whole record"):
        read_dataflash(path)
    with pytest.raises(InputError, match="no file"):
        read_dataflash(tmp_path / "missing.bin")
