"""PX4's on-board logs: every topic and value as pyulog has them, and what damage costs."""

from __future__ import annotations

import contextlib
import gzip
import io
import lzma
import struct
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog

from companion.logs import Ulog, UlogTopic, read_ulog
from companion.model import InputError
from companion.telemetry import TOPICS
from tests.recordings import ROOT, all_shared
from tests.ulogs import head, key, message

pytestmark = pytest.mark.slow

CUTS = [
    ROOT / "tests" / "telemetry" / "logs" / "px4_two_imus.ulg.xz",
    ROOT / "tests" / "telemetry" / "logs" / "px4_accel_step.ulg.xz",
    ROOT / "tests" / "data" / "px4__px4_gcs_default.ulg.xz",
]


def unpacked(path: Path) -> bytes:
    contents = path.read_bytes()
    return lzma.decompress(contents) if path.suffix == ".xz" else contents


def read_with_pyulog(contents: bytes) -> ULog:
    with contextlib.redirect_stdout(io.StringIO()):  # it prints what it thinks of a file
        return ULog(io.BytesIO(contents))


def by_name(log: Ulog) -> dict[tuple[str, int], UlogTopic]:
    return {(topic.name, topic.instance): topic for topic in log.topics}


def read(folder: Path, contents: bytes, **how: Any) -> Ulog:
    path = folder / "log.ulg"
    path.write_bytes(contents)
    return read_ulog(path, **how)


def flat_names(dtype: np.dtype[Any], prefix: str = "") -> Iterator[str]:
    """Each basic field of a structure as PX4's tools write it: `x`, `q[0]`, `esc[1].rpm`."""
    for name in dtype.names or ():
        kind, shape = dtype[name].base, dtype[name].shape
        for own in [f"{prefix}{name}[{i}]" for i in range(shape[0])] if shape else [f"{prefix}{name}"]:
            yield from [own] if kind.names is None else flat_names(kind, f"{own}.")


def assert_same(log: Ulog, theirs: ULog) -> None:
    topics = by_name(log)
    assert topics.keys() == {(one.name, one.multi_id) for one in theirs.data_list}
    for one in theirs.data_list:
        topic = topics[one.name, one.multi_id]
        assert list(flat_names(topic.rows.dtype)) == list(one.data)
        for field, values in one.data.items():
            assert topic[field].dtype == values.dtype
            assert topic[field].tobytes() == values.tobytes(), f"{one.name}.{field}"
    assert log.infos == theirs.msg_info_dict
    assert log.parameters == pytest.approx(theirs.initial_parameters, rel=0, abs=0, nan_ok=True)
    assert list(log.parameter_changes) == theirs.changed_parameters
    texts = [*theirs.logged_messages, *(text for one in theirs.logged_messages_tagged.values() for text in one)]
    said = sorted((text.timestamp, text.log_level, text.message) for text in texts)
    assert sorted((text.stamp, text.level + ord("0"), text.text) for text in log.texts) == said
    own_dropouts = [(at, round(seconds * 1e3)) for at, seconds in log.dropouts]
    assert own_dropouts == [(one.timestamp, one.duration) for one in theirs.dropouts]
    assert log.begun == theirs.start_timestamp


@pytest.mark.parametrize("path", [*CUTS, *all_shared(".ulg", ".ulg.xz")], ids=lambda path: path.name)
def test_every_topic_and_value_is_what_pyulog_reads(path: Path) -> None:
    """Of a damaged log pyulog reads less: it goes on at a mark, of which there are two a second, or not at all."""
    contents = unpacked(path)
    log, theirs = read_ulog(path), read_with_pyulog(contents)
    if not log.skipped_bytes:
        assert_same(log, theirs)
    counts = {name: len(topic) for name, topic in by_name(log).items()}
    assert all(counts[one.name, one.multi_id] >= len(one.data["timestamp"]) for one in theirs.data_list)


SECONDS = 4


def data(number: int, layout: str, *values: Any) -> bytes:
    return message(b"D", struct.pack("<H" + layout, number, *values))


def subscription(number: int, name: str, instance: int = 0) -> bytes:
    return message(b"A", struct.pack("<BH", instance, number) + name.encode())


def definitions(*formats: str, incompatible: int = 0, appended: tuple[int, ...] = ()) -> bytes:
    offsets = struct.pack("<3Q", *appended, *[0] * (3 - len(appended)))
    flags = message(b"B", bytes([1, *[0] * 7, incompatible, *[0] * 7]) + offsets)
    return head(5_000_000) + flags + b"".join(message(b"F", text.encode()) for text in formats)


FORMATS = (
    "gyro:uint64_t timestamp;uint32_t id;float[3] xyz;bool ok;uint8_t[3] _padding0;",
    "esc:uint64_t timestamp;int16_t rpm;uint8_t[2] _padding0;esc_part[2] part;esc_part last;",
    "esc_part:float volt;char[4] name;",
    "late:uint64_t timestamp;double x;",
)


def gyro(number: int, i: int) -> bytes:
    return data(number, "QIfffB", 5_000_000 + i * 10_000 + number, number, i, -i, 0.5 * i, i % 2)


def esc(i: int) -> bytes:
    of = (1.5, b"left", 2.5, b"righ", float(i), b"last")
    return data(2, "Qhxx" + "f4s" * 3, 5_000_000 + i * 10_000, -i, *of)


def everything(*, appended: tuple[int, ...] = ()) -> list[bytes]:
    """The messages of a log that has one of all there is."""
    out = [definitions(*FORMATS, incompatible=bool(appended), appended=appended)]
    out += [message(b"I", key("char[3] sys_name") + b"PX4"), message(b"I", key("uint32_t ver") + b"\1\2\3\4")]
    out += [message(b"M", bytes([more]) + key("char[2] boot") + text) for more, text in enumerate((b"ab", b"cd"))]
    out += [message(b"M", b"\0" + key("char[2] boot") + b"ef")]
    out += [message(b"P", key("float A") + struct.pack("<f", 0.5)), message(b"P", key("int32_t B") + b"\7\0\0\0")]
    out += [message(b"Q", b"\3" + key("int32_t B") + b"\5\0\0\0"), message(b"Q", b"\1" + key("float A") + bytes(4))]
    out += [subscription(0, "gyro"), subscription(1, "gyro", 1), subscription(2, "esc")]
    for i in range(100 * SECONDS):
        out += [gyro(0, i), gyro(1, i), esc(i)]
        if i % 50 == 0:
            out += [message(b"S", bytes.fromhex("2F731320250CBB12"))]
        if i == 120:
            out += [message(b"L", b"6" + struct.pack("<Q", 6_200_000) + b"armed")]
            out += [message(b"C", b"4" + struct.pack("<HQ", 7, 6_200_001) + "tägged".encode())]
            out += [message(b"P", key("float A") + struct.pack("<f", 1.5)), message(b"O", struct.pack("<H", 250))]
        if i == 200:
            out += [subscription(3, "late")]
        if i > 200:
            out += [data(3, "Qd", 5_000_000 + i * 10_000, i * 1e-3)]
    return out


def test_all_that_a_log_may_say(tmp_path: Path) -> None:
    contents = b"".join(everything())
    log = read(tmp_path, contents)
    assert_same(log, read_with_pyulog(contents))
    assert (log.skipped_bytes, log.cut_bytes, log.unknown, log.undecoded) == (0, 0, 0, {})
    topics = by_name(log)
    assert {name: len(topic) for name, topic in topics.items()} == {
        ("gyro", 0): 400, ("gyro", 1): 400, ("esc", 0): 400, ("late", 0): 199,
    }  # fmt: skip
    assert topics["gyro", 1]["xyz[2]"].tolist() == [0.5 * i for i in range(400)]
    assert topics["gyro", 1].rows["xyz"].shape == (400, 3)
    assert topics["esc", 0]["part[1].volt"].tolist() == [2.5] * 400
    assert topics["esc", 0]["last.name[3]"].tobytes() == b"t" * 400
    assert "xyz" not in topics["gyro", 0]
    assert "xyz[3]" not in topics["gyro", 0]
    assert log.parameters == {"A": 0.5, "B": 7}
    assert log.parameter_changes == ((6_200_001, "A", 1.5),)
    assert log.dropouts == ((6_200_001, 0.25),)
    assert [(text.level, text.text) for text in log.texts] == [(6, "armed"), (4, "tägged")]


def test_padding_at_the_end_may_be_there_or_not(tmp_path: Path) -> None:
    """PX4 leaves it out; a writer of its own may not."""
    padded = [data(0, "QIfffB3x", 5_000_000 + i, 0, i, 0, 0, 1) if i % 3 else gyro(0, i) for i in range(9)]
    log = read(tmp_path, definitions(*FORMATS) + subscription(0, "gyro") + b"".join(padded))
    assert log.topics[0]["xyz[0]"].tolist() == list(range(9))


def test_only_the_topics_asked_for_are_read(tmp_path: Path) -> None:
    log = read(tmp_path, b"".join(everything()), names={"esc"})
    topics = by_name(log)
    assert topics["esc", 0]["rpm"].tolist() == [-i for i in range(400)]
    assert topics["gyro", 1]["timestamp"].tolist() == [5_000_001 + 10_000 * i for i in range(400)]
    for ask in (topics["gyro", 1].get, topics["gyro", 1].__contains__):
        with pytest.raises(LookupError, match="names"):
            ask("xyz[0]")
    with pytest.raises(KeyError, match="no field 'xyz'"):
        topics["gyro", 1]["xyz"]


def test_tracks_are_made_of_the_topics_that_are_read() -> None:
    """A topic that is asked for a field and was not read is an error: this one has those of today's PX4."""
    whole = by_name(read_ulog(CUTS[0]))
    part = by_name(read_ulog(CUTS[0], names=TOPICS))
    assert whole.keys() == part.keys()
    for name, topic in part.items():
        assert topic.fields_read == (name[0] in TOPICS)
        assert topic["timestamp"].tobytes() == whole[name]["timestamp"].tobytes()


def test_data_that_was_added_after_a_crash(tmp_path: Path) -> None:
    """The log ends in the middle of a message; where the next begins stands in its head. pyulog has no data there."""
    size = len(b"".join(everything())) - 10
    contents = b"".join(everything(appended=(size,)))[:size]
    contents += message(b"M", b"\0" + key("char[5] hardfault") + b"stack")
    assert_same(read(tmp_path, contents), read_with_pyulog(contents))
    log = read(tmp_path, contents + gyro(0, 500))
    assert log.appended
    assert len(by_name(log)["gyro", 0]) == 401
    assert (log.skipped_bytes, log.cut_bytes) == (0, len(data(3, "Qd", 0, 0)) - 10)


@pytest.mark.parametrize(("at", "cost"), [(0, 0), (17, 0), (10**18, 0), (20_001, 1)])
def test_an_offset_of_added_data_that_cannot_be_costs_a_message_at_most(tmp_path: Path, at: int, cost: int) -> None:
    log = read(tmp_path, b"".join(everything(appended=(at,))))
    assert kept(log) == 3 * 400 + 199 - cost


def test_data_that_stand_alone_are_read_in_time(tmp_path: Path) -> None:
    """Each between two marks, and numbers that are new again and again: nothing is looked through twice."""
    text = message(b"L", b"6" + bytes(8) + b"tick")
    alone = b"".join(gyro(0, i) + text for i in range(8_000))
    log = read(tmp_path, definitions(*FORMATS) + subscription(0, "gyro") + alone)
    assert (kept(log), len(log.texts), log.skipped_bytes) == (8_000, 8_000, 0)
    new = b"".join(subscription(i, "gyro", i % 200) + gyro(i, i) * 2 + bytes([2, 0]) + b"R\0\0" for i in range(1_000))
    log = read(tmp_path, definitions(*FORMATS) + new)
    assert (kept(log), log.skipped_bytes) == (2_000, 0)


def test_a_number_that_changes_its_topic(tmp_path: Path) -> None:
    """By R and A, or by A alone. The same A again changes nothing."""
    out = [definitions(*FORMATS), subscription(0, "gyro"), *(gyro(0, i) for i in range(50)), subscription(0, "gyro")]
    out += [*(gyro(0, i) for i in range(50, 100)), message(b"R", b"\0\0"), gyro(0, 1000), subscription(0, "late")]
    out += [data(0, "Qd", 5_000_000 + i, i) for i in range(70)]
    out += [subscription(0, "gyro", 1), *(gyro(0, i) for i in range(30))]
    log = read(tmp_path, b"".join(out))
    topics = by_name(log)
    assert topics["gyro", 0]["xyz[0]"].tolist() == list(range(100))
    assert topics["late", 0]["x"].tolist() == list(range(70))
    assert topics["gyro", 1]["xyz[0]"].tolist() == list(range(30))
    assert sum(log.undecoded.values()) == 1


def rows_of(log: Ulog) -> dict[tuple[str, int], set[bytes]]:
    return {name: {row.tobytes() for row in topic.rows} for name, topic in by_name(log).items()}


def kept(log: Ulog) -> int:
    return sum(len(topic) for topic in log.topics)


def test_damage_costs_the_messages_it_touches(tmp_path: Path) -> None:
    """Headers overwritten at many places: those messages are lost, and no others (each has an intact neighbour)."""
    messages = everything()
    whole = read(tmp_path, b"".join(messages))
    first = 14  # of data
    hit = set(range(first, len(messages), 7))
    damaged = [b"\0\0\0" + one[3:] if i in hit else one for i, one in enumerate(messages)]
    log = read(tmp_path, b"".join(damaged))
    lost = [one for i, one in enumerate(messages) if i in hit and one[2:3] in b"DA"]
    late = sum(one[2:5] == b"D\3\0" for i, one in enumerate(messages) if i not in hit)
    assert log.skipped_bytes == sum(len(one) for i, one in enumerate(messages) if i in hit)
    if any(one[2:3] == b"A" for one in lost):
        assert log.undecoded == {"": late}
    else:
        assert kept(log) == kept(whole) - len(lost)


JUNK = [bytes(5000), b"\xff" * 5000, b"D" * 5000, np.random.default_rng(1).integers(0, 256, 5000, np.uint8).tobytes()]


@pytest.mark.parametrize("junk", JUNK, ids=["zeros", "ones", "types", "noise"])
def test_junk_in_the_middle_and_at_the_end(tmp_path: Path, junk: bytes) -> None:
    """In the head and among the data, between two messages."""
    messages = everything()
    whole = read(tmp_path, b"".join(messages))
    for place in (5, 40, 700):
        contents = b"".join(messages[:place]) + junk + b"".join(messages[place:]) + junk
        log = read(tmp_path, contents)
        assert rows_of(log) == rows_of(whole)
        assert log.skipped_bytes + log.cut_bytes == 2 * len(junk)
        assert (log.parameters, log.infos, log.texts) == (whole.parameters, whole.infos, whole.texts)


def test_cut_at_every_byte_of_the_last_messages(tmp_path: Path) -> None:
    messages = everything()
    contents = b"".join(messages)
    last = sum(len(one) for one in messages[-3:])
    for end in range(len(contents) - last, len(contents)):
        log = read(tmp_path, contents[:end])
        at = kept_bytes = 0
        for one in messages:
            at += len(one)
            kept_bytes = at if at <= end else kept_bytes
        assert (log.skipped_bytes, log.cut_bytes) == (0, end - kept_bytes)


def test_a_flipped_bit_costs_two_messages_at_most(tmp_path: Path) -> None:
    """One whose size is damaged may lead exactly to the end of another."""
    messages = everything()
    begin = sum(len(one) for one in messages[:14])
    contents = b"".join(messages)
    whole = kept(read(tmp_path, contents))
    random = np.random.default_rng(3)
    for at, bit in zip(random.integers(begin, len(contents), 150), random.integers(0, 8, 150), strict=True):
        damaged = bytearray(contents)
        damaged[at] ^= 1 << int(bit)
        log = read(tmp_path, bytes(damaged))
        assert kept(log) + sum(log.undecoded.values()) >= whole - 2
        assert log.skipped_bytes + log.cut_bytes <= 200


def test_lost_bytes_cost_the_messages_that_they_were_of(tmp_path: Path) -> None:
    """As where a card was too slow for the logger. A message that lost its middle seems to go on in the next ones.

    Only where it then ends exactly where one of these does, nothing tells them apart, and that one is lost too.
    """
    messages = everything()
    begins = np.cumsum([0, *(len(one) for one in messages)])
    contents = b"".join(messages)
    random = np.random.default_rng(4)
    more = 0
    for at in random.integers(begins[14], len(contents) - 400, 150).tolist():
        size = int(random.integers(1, 200))
        log = read(tmp_path, contents[:at] + contents[at + size :])
        untouched = [one for i, one in enumerate(messages) if begins[i + 1] <= at or begins[i] >= at + size]
        declared = {one[4] for one in untouched if one[2:3] == b"A"}
        expected = {one[5:] for one in untouched if one[2:3] == b"D" and one[3] in declared}
        lost = expected - set().union(*rows_of(log).values())
        more += len(lost)
        assert len(lost) <= 1
        assert kept(log) <= len(expected) + 1
        assert len(log.texts) == sum(one[2:3] in b"LC" for one in untouched)
    assert more <= 3


def test_a_message_of_an_unknown_type_is_passed_over(tmp_path: Path) -> None:
    """Later versions of the format may add some."""
    messages = everything()
    whole = read(tmp_path, b"".join(messages))
    for place in (5, 100, 200):
        log = read(tmp_path, b"".join([*messages[:place], message(b"Z", b"whatever"), *messages[place:]]))
        assert rows_of(log) == rows_of(whole)
        assert (log.unknown, log.skipped_bytes) == (1, 0)


@pytest.mark.parametrize(
    ("said", "damaged"),
    [
        (b"gyro:uint64_t", b"gyro:uinu64_t"),
        (b"gyro:uint64_t timestamp;", b"gyro:uint64_t timestamp,"),
        (b"float[3] xyz", b"float[9] xyz"),
        (b"uint32_t id", b"uint32_t ok"),
        (b"float volt;char[4] name", b"float volt;esc_part nam"),
    ],
)
def test_a_damaged_definition_costs_its_data(tmp_path: Path, said: bytes, damaged: bytes) -> None:
    log = read(tmp_path, b"".join(everything()).replace(said, damaged))
    lost = {"esc": 400} if b"volt" in said else {"gyro": 800}
    assert log.skipped_bytes == 0
    assert sum(log.undecoded.values()) == sum(lost.values())
    assert {topic.name for topic in log.topics} == {"esc", "gyro", "late"} - lost.keys()


def test_compressed_logs_are_the_same(tmp_path: Path) -> None:
    contents = unpacked(CUTS[1])
    plain = read(tmp_path, contents)
    (tmp_path / "log.gz").write_bytes(gzip.compress(contents, 1))
    packed = read_ulog(tmp_path / "log.gz")
    assert rows_of(plain) == rows_of(packed)
    assert packed.content_bytes == plain.size_bytes == len(contents)


def test_progress_adds_up_to_the_file(tmp_path: Path) -> None:
    told: list[int] = []
    log = read(tmp_path, unpacked(CUTS[0]), progress=told.append)
    assert sum(told) == pytest.approx(log.size_bytes, abs=100)
    assert len(told) > 3


LIES = {
    "data without end": b"D" * 500_000,
    "sizes that lead nowhere": b"\xff\xffD" * 200_000,
    "subscriptions": b"".join(subscription(i, "huge", i % 200) for i in range(10_000)),
    "formats": b"".join(message(b"F", b"a%d:huge[2] x;" % i) for i in range(10_000)),
    "texts": message(b"L", b"6" + bytes(8)) * 20_000,
}


@pytest.mark.parametrize("name", LIES)
def test_what_is_only_claimed_takes_no_memory(tmp_path: Path, name: str) -> None:
    contents = definitions("huge:uint64_t timestamp;char[65000] x;") + LIES[name]
    tracemalloc.start()
    with pytest.raises(InputError, match="no data can be read|more bytes than a message can have"):
        read(tmp_path, contents)
    assert tracemalloc.get_traced_memory()[1] < 60 * len(contents) + 20_000_000
    tracemalloc.stop()


def test_random_bytes_behind_the_magic_never_raise_anything_else(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    letters = np.frombuffer(b"\0\1\2\3\x08BFAIMPQLCOSDR:; ", np.uint8)
    for size in (0, 1, 2, 20, 50, 1000, 100_000):
        noise = rng.choice(letters, size).tobytes()
        for before in (head(), b"".join(everything())):
            with contextlib.suppress(InputError):
                log = read(tmp_path, before + noise)
                assert log.skipped_bytes <= log.size_bytes
                assert kept(log) >= 1399


def test_other_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "log.ulg"
    path.write_bytes(b"\xa3\x95\x80\x80" + bytes(100))
    with pytest.raises(InputError, match=r"no PX4 ULog: it begins with A3 95 80 80"):
        read_ulog(path)
    path.write_bytes(head()[:12])
    with pytest.raises(InputError, match="no data can be read"):
        read_ulog(path)
    with pytest.raises(InputError, match="no file"):
        read_ulog(tmp_path / "missing.ulg")
    with pytest.raises(InputError, match=r"incompatible flags 02 00 .* newer format"):
        read(tmp_path, b"".join(everything()).replace(bytes([1, *[0] * 15]), bytes([1, *[0] * 7, 2, *[0] * 7]), 1))
