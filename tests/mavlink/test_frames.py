"""Recovery equals truth: every valid frame among damage is found, none that is not, however the bytes are cut."""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pymavlink.dialects.v20.ardupilotmega as mavlink
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mavlink import Damage, Decoder, load_dialect, split_messages
from tests.links.link import link_frames, stamped, unknown_frame
from tests.recordings import BUNDLED, recording

pytestmark = pytest.mark.slow

DIALECT = load_dialect()
EPOCH = 1_700_000_000_000_000  # µs


def decode(
    data: bytes, cuts: Sequence[int] = (), *, with_stamps: bool = True
) -> tuple[list[tuple[int, bytes]], Damage]:
    """Offset and bytes of each frame found, when the stream arrives cut at `cuts`."""
    decoder = Decoder(DIALECT, stamped=with_stamps)
    edges = [0, *sorted(cuts), len(data)]
    pieces = [decoder.push(data[a:b]) for a, b in pairwise(edges)] + [decoder.finish()]
    found = []
    for frames in pieces:
        for start, size, offset in zip(frames.start, frames.size, frames.offset, strict=True):
            found.append((int(offset), frames.data[start : start + size].tobytes()))
    return found, decoder.damage


def expect(parts: Sequence[tuple[bytes, bool]], cuts: int = 40) -> Damage:
    """Join parts, of which those marked are a stamp and a valid frame: exactly these must be found, however cut."""
    data = b"".join(part for part, _ in parts)
    truth, position = [], 0
    for part, valid in parts:
        if valid:
            truth.append((position + 8, part[8:]))
        position += len(part)
    found, damage = decode(data)
    assert found == truth
    places = np.random.default_rng(len(data)).integers(0, len(data) + 1, cuts).tolist()
    assert decode(data, places) == (found, damage)
    return damage


def log_of(count: int, *, seed: int = 1, version: int = 2) -> list[bytes]:
    """The packets of a tlog: each a stamp and a frame."""
    frames = link_frames(count, seed=seed, version=version)
    return [stamped(frame, EPOCH + 10_000 * index) for index, frame in enumerate(frames)]


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("signed", [False, True])
def test_intact(version: int, signed: bool) -> None:
    packets = [
        stamped(frame, EPOCH + index)
        for index, frame in enumerate(link_frames(2000, version=version, signed=signed and version == 2))
    ]
    assert expect([(packet, True) for packet in packets]) == Damage()


def test_versions_mixed() -> None:
    packets = [packet for pair in zip(log_of(500, version=1), log_of(500), strict=True) for packet in pair]
    assert expect([(packet, True) for packet in packets]) == Damage()


def test_a_thousand_flipped_payload_bytes() -> None:
    rng = np.random.default_rng(2)
    packets = log_of(5000)
    hit = set(rng.choice(len(packets), 1000, replace=False).tolist())
    parts = []
    for index, packet in enumerate(packets):
        damaged = bytearray(packet)
        if index in hit:
            damaged[int(rng.integers(8 + 10, len(packet) - 2))] ^= int(rng.integers(1, 256))
        parts.append((bytes(damaged), index not in hit))
    assert expect(parts).bad_crc_frames == 1000


def test_any_flipped_byte_costs_its_own_frame_only() -> None:
    packets = log_of(8)
    for index in range(8, len(packets[3])):
        damaged = bytearray(packets[3])
        damaged[index] ^= 0x55
        expect([(packet if i != 3 else bytes(damaged), i != 3) for i, packet in enumerate(packets)], cuts=10)


def test_junk_at_a_thousand_places() -> None:
    rng = np.random.default_rng(3)
    parts: list[tuple[bytes, bool]] = []
    junk_bytes = 0
    for packet in log_of(1000):
        junk = rng.integers(0, 256, int(rng.integers(1, 80)), np.uint8).tobytes()
        junk_bytes += len(junk)
        parts += [(junk, False), (packet, True)]
    assert expect(parts).skipped_bytes == junk_bytes


@pytest.mark.parametrize("known", [b"", next(link_frames(1))])
def test_made_up_ids_do_not_fill_the_memory(known: bytes) -> None:
    decoder = Decoder(load_dialect(), stamped=False, unknown=True)
    for begin in range(0, 6000, 500):
        made_up = (unknown_frame(1_000_000 + begin + i, b"x", i % 256) for i in range(500))
        decoder.push(b"".join(made_up) + known)
    assert decoder.damage.unknown_frames or decoder._pending
    assert len(decoder.damage.unknown_frames) <= 2048
    assert len(decoder._pending) <= 2048


def test_a_thousand_frames_of_unknown_ids_are_named_and_nothing_is_skipped() -> None:
    rng = np.random.default_rng(4)
    parts: list[tuple[bytes, bool]] = []
    for index, packet in enumerate(log_of(1000)):
        payload = rng.integers(0, 256, int(rng.integers(1, 255)), np.uint8).tobytes()
        frame = unknown_frame(60_000 + index % 3, payload, index % 256)
        parts += [(packet, True), (stamped(frame, EPOCH), False)]
    damage = expect(parts)
    assert damage.unknown_frames == {60_000: 334, 60_001: 333, 60_002: 333}
    assert damage.skipped_bytes == 0


@pytest.mark.parametrize("cuts", [0, 1, 60])
def test_a_link_gives_intact_frames_of_unknown_ids_in_their_place(cuts: int) -> None:
    """PX4 sends ids that no dialect of pymavlink has: a recording that lacks them has lost something."""
    frames = list(link_frames(200))
    for index in range(3, 200, 4):
        frames[index] = unknown_frame(60_000 + index, bytes([index] * (index % 60 + 1)), index)
    stream = b"".join(frames)
    decoder = Decoder(DIALECT, stamped=False, unknown=True)
    edges = [0, *sorted(np.random.default_rng(5).integers(0, len(stream), cuts).tolist()), len(stream)]
    pieces = [decoder.push(stream[a:b]) for a, b in pairwise(edges)] + [decoder.finish()]
    given = [
        some.data[start : start + size].tobytes()
        for some in pieces
        for start, size in zip(some.start, some.size, strict=True)
    ]
    assert given == frames
    assert decoder.damage.skipped_bytes == 0
    known = sum(len(columns) for some in pieces for columns in split_messages(some, DIALECT).values())
    assert known == 150


def test_noise_is_no_frame_of_an_unknown_id() -> None:
    noise = np.random.default_rng(8).integers(0, 256, 300_000, np.uint8).tobytes()
    decoder = Decoder(DIALECT, stamped=False, unknown=True)
    known = Decoder(DIALECT, stamped=False)
    assert len(decoder.push(noise)) + len(decoder.finish()) == len(known.push(noise)) + len(known.finish())


def test_a_damaged_id_is_not_an_unknown_message() -> None:
    """The chain fits, but the CRC is right with no CRC_EXTRA at all."""
    packets = log_of(50)
    parts = [(packet, True) for packet in packets]
    for index in range(5, 50, 10):
        damaged = bytearray(packets[index])
        damaged[8 + 8] = 0xEE  # the middle byte of the id
        parts[index] = (bytes(damaged), False)
    damage = expect(parts)
    assert not damage.unknown_frames
    assert damage.skipped_bytes == sum(len(packets[index]) - 8 for index in range(5, 50, 10)) + 8 * 5


def test_cut_at_every_byte_of_the_last_frame() -> None:
    packets = log_of(9)
    for length in range(len(packets[-1])):
        damage = expect([*((packet, True) for packet in packets[:-1]), (packets[-1][:length], False)], cuts=10)
        assert damage.skipped_bytes == max(length, 0)


def test_begun_at_every_byte_of_the_first_frame() -> None:
    packets = log_of(9)
    for length in range(9, len(packets[0])):
        expect([(packets[0][length:], False), *((packet, True) for packet in packets[1:])], cuts=10)


@pytest.mark.parametrize("filler", [b"\0", b"\xff", b"\xfd", b"\r\n"])
def test_runs_of_one_byte_at_head_middle_and_tail(filler: bytes) -> None:
    packets = [(packet, True) for packet in log_of(300)]
    run = (filler * 300_000, False)
    damage = expect([run, *packets[:100], run, *packets[100:], run])
    assert damage.skipped_bytes == 3 * len(run[0])


def test_writers_interleaved_at_their_buffer_boundaries() -> None:
    """Two programs write one file in blocks of 4096 bytes: frames across a block's edge are lost, no others."""
    writers = [log_of(2000, seed=5), log_of(2000, seed=6)]
    data, truth = b"", []
    for block in range(20):
        for packets in writers:
            begin, position = 4096 * block, 0
            for packet in packets:
                if position + 8 >= begin and position + len(packet) <= begin + 4096:
                    truth.append((len(data) + position + 8 - begin, packet[8:]))  # its stamp may lie elsewhere
                position += len(packet)
            data += b"".join(packets)[begin : begin + 4096]
    found, damage = decode(data)
    assert found == truth
    assert decode(data, range(0, len(data), 1000)) == (found, damage)


def test_line_ends_mangled() -> None:
    """As after an upload as text: each LF has become CR LF."""
    parts = []
    for packet in log_of(4000):
        mangled = packet[:8].replace(b"\n", b"\r\n"), packet[8:].replace(b"\n", b"\r\n")
        if mangled[1] == packet[8:] and len(mangled[0]) > 8:  # the frame is whole, its stamp grew at the front
            parts.append((mangled[0][:-8], False))
            parts.append((mangled[0][-8:] + mangled[1], True))
        else:
            parts.append((b"".join(mangled), mangled[1] == packet[8:]))
    expect(parts)


def test_console_text_framed_byte_by_byte() -> None:
    """MAVProxy once stamped each byte of a boot console; the bytes have stamps but are no frames."""
    text = b"Init ArduCopter V3.1\xfe\xfd\n" * 40
    console = b"".join(stamped(text[i : i + 1], EPOCH) for i in range(len(text)))
    packets = [(packet, True) for packet in log_of(100)]
    assert expect([*packets[:50], (console, False), *packets[50:]]).skipped_bytes == len(console)


def test_a_frame_inside_the_payload_of_a_frame_is_not_a_frame() -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    inner = next(link_frames(1))
    outer = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, list((bytes(20) + inner).ljust(251, b"\1"))).pack(
        link
    )
    packets = log_of(3)
    expect([(packets[0], True), (stamped(outer, EPOCH), True), (packets[1], True)])


def closed(begun: bytes, number: int) -> bytes:
    """A frame with its CRC."""
    crc = mavlink.x25crc(begun[1:])
    crc.accumulate([mavlink.mavlink_map[number].crc_extra])
    return begun + struct.pack("<H", crc.crc)


def test_of_frames_that_overlap_the_one_that_begins_first_counts() -> None:
    """A of MAVLink 1 overlaps B of MAVLink 2, in whose rest lies C of MAVLink 1: A and C are frames."""
    third = next(link_frames(1, version=1))
    transfer, encapsulated = 110, 131
    head_b = struct.pack("<BBBBBBBHB", 0xFD, 255, 0, 0, 0, 1, 1, encapsulated, 0)
    first = closed(struct.pack("<BBBBBB", 0xFE, 254, 0, 1, 1, transfer) + bytes(230) + head_b + b"\1" * 14, transfer)
    inside = first[first.index(head_b) + len(head_b) :] + b"\1" * 20 + third
    second = closed(head_b + inside.ljust(255, b"\1"), encapsulated)
    whole = first[: first.index(head_b)] + second
    packets = log_of(60)
    between, behind = whole[len(first) :].split(third)
    expect(
        [(packet, True) for packet in packets[:30]]
        + [(stamped(first, EPOCH), True), (between[:-8], False), (between[-8:] + third, True), (behind, False)]
        + [(packet, True) for packet in packets[30:]]
    )


def test_frames_without_stamps() -> None:
    frames = list(link_frames(500))
    data = b"".join(frames)
    found, damage = decode(data, with_stamps=False)
    assert [frame for _, frame in found] == frames
    assert damage == Damage()
    assert decode(data, range(0, len(data), 7), with_stamps=False) == (found, damage)


def test_a_live_frame_comes_out_with_its_last_byte() -> None:
    decoder = Decoder(DIALECT, stamped=False)
    for frame in link_frames(50):
        assert len(decoder.push(frame[:-1])) == 0
        assert len(decoder.push(frame[-1:])) == 1


def right_crcs(data: bytes) -> dict[int, int]:
    """Offset -> end of everything in `data` that is a frame, wherever it begins: the specification, byte by byte."""
    found = {}
    for begin in range(len(data)):
        head = data[begin : begin + 10]
        if head[:1] == b"\xfe" and len(head) >= 6:
            body, number, tail = begin + 6, head[5], 2
        elif head[:1] == b"\xfd" and len(head) == 10 and head[2] in (0, 1):
            body, number, tail = begin + 10, int.from_bytes(head[7:10], "little"), 2 + 13 * head[2]
        else:
            continue
        end = body + head[1]
        if number in mavlink.mavlink_map and end + tail <= len(data):
            crc = mavlink.x25crc(data[begin + 1 : end])
            crc.accumulate([mavlink.mavlink_map[number].crc_extra])
            if crc.crc == int.from_bytes(data[end : end + 2], "little"):
                found[begin] = end + tail
    return found


@pytest.mark.parametrize("name", ["LucaGemma__MasterThesis__mav", "SemvdH__5g_drone_ROS2__src_mav"])
def test_damaged_recordings_give_exactly_what_the_specification_finds(name: str) -> None:
    data = recording(f"public/{name}.tlog").read_bytes()
    assert {offset: offset + len(frame) for offset, frame in decode(data)[0]} == right_crcs(data)


FRAMES = [*link_frames(14, seed=7), *link_frames(7, seed=8, version=1), *link_frames(7, seed=9, signed=True)]
ODD = b"\xfe\x03\x01\x01\x01\x00abc"  # a HEARTBEAT of a length that none has, with its right CRC
ODD += struct.pack("<H", mavlink.x25crc(ODD[1:] + bytes([50])).crc)
PIECES = st.one_of(
    st.sampled_from(FRAMES).map(lambda frame: stamped(frame, EPOCH)),
    st.sampled_from([*FRAMES, ODD]),
    st.tuples(st.sampled_from([*FRAMES, ODD]), st.integers(1, 30)).map(lambda pair: pair[0][: pair[1]]),
    st.tuples(st.sampled_from(FRAMES), st.integers(1, 30)).map(lambda pair: pair[0][pair[1] :]),
    st.binary(max_size=40),
    st.lists(st.sampled_from([0xFE, 0xFD, 0, 1, 9, 27, 30, 255]), max_size=40).map(bytes),
    st.just(unknown_frame(60_000, b"abc", 1)).map(lambda frame: stamped(frame, EPOCH)),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(PIECES, max_size=12), st.lists(st.integers(0, 2000), max_size=6), st.booleans())
def test_any_garbage(pieces: list[bytes], cuts: list[int], with_stamps: bool) -> None:
    data = b"".join(pieces)
    found, damage = decode(data, with_stamps=with_stamps)
    truth = right_crcs(data)
    ends = {offset: offset + len(frame) for offset, frame in found}
    assert ends.items() <= truth.items()
    assert sorted(ends) == [offset for offset, _ in found]
    assert all(end <= begin for end, begin in zip(list(ends.values())[:-1], list(ends)[1:], strict=True))
    for begin, end in truth.items():  # what was not taken overlaps what was
        assert any(begin < e and end > b for b, e in ends.items())
    cut = decode(data, [c % (len(data) + 1) for c in cuts], with_stamps=with_stamps)
    assert cut == (found, damage)
    if len(data) < 100:  # byte by byte, which takes most of the time
        assert decode(data, range(len(data)), with_stamps=with_stamps) == (found, damage)
    covered = sum(len(frame) for _, frame in found)
    if not with_stamps and not damage.unknown_frames:
        assert damage.skipped_bytes == len(data) - covered


@pytest.mark.parametrize(
    "pattern", [b"\xfe", b"\xfe\x00", b"\xfe\x09\xfe\x09\xfe\x00", b"\xfd\x00", b"\xfe\xff\xfd\x01\x00"]
)
def test_the_worst_garbage_takes_linear_time(pattern: bytes) -> None:
    def seconds(size: int) -> float:
        data = (pattern * size)[:size]
        start = time.process_time()
        decode(data)
        return time.process_time() - start

    seconds(50_000)  # warm
    # linear is a factor of 4, quadratic of 16; once in five times the machine has nothing else to do
    assert any(seconds(800_000) < 8 * seconds(200_000) + 0.05 for _ in range(5))


@pytest.mark.parametrize("stamped", [True, False])
def test_a_small_dialect_calls_the_rest_unknown_and_not_damaged(stamped: bool) -> None:
    """What looks like a frame of it inside the payload of another is none, where the chain of lengths holds."""
    data = (BUNDLED / "copter-demo-100hz.tlog").read_bytes()
    whole = Decoder(load_dialect(), stamped=True)
    frames = whole.push(data)
    known = Counter(frames.id.tolist())
    if not stamped:
        spans = zip(frames.start.tolist(), frames.size.tolist(), strict=True)
        data = b"".join(frames.data[start : start + size].tobytes() for start, size in spans)
    minimal = load_dialect("minimal")
    decoder = Decoder(minimal, stamped=stamped)
    for begin in range(0, len(data), 10_007):
        decoder.push(data[begin : begin + 10_007])
    decoder.finish()
    expected = {number: count for number, count in known.items() if number not in minimal.by_id}
    assert dict(decoder.damage.unknown_frames) == expected
    assert (decoder.damage.bad_crc_frames, decoder.damage.skipped_bytes) == (0, 0)
    at = data.index(bytes([1, 1, 27, 0, 0])) + 20  # in the payload of a RAW_IMU: the chain still holds
    decoder = Decoder(minimal, stamped=stamped)
    decoder.push(data[:at] + bytes([data[at] ^ 0xFF]) + data[at + 1 :])
    decoder.finish()
    assert decoder.damage.unknown_frames[27] >= expected[27] - 1
    assert decoder.damage.bad_crc_frames == 0
