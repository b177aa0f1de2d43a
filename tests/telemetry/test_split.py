"""A link on which more speak than there can be: the vehicle stays, and the work is bounded."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from companion.app.recording import read_recording
from companion.mavlink import DEFAULT_DIALECT, Decoder, Frames, load_dialect
from companion.telemetry import Stream
from companion.telemetry.split import MOST_SENDERS, BusiestSenders
from tests.tlogs import Writer

DIALECT = load_dialect(DEFAULT_DIALECT)


def said(senders: list[tuple[int, int]], folder: Path) -> Frames:
    log = Writer(folder / "said.tlog")
    for i, (sysid, compid) in enumerate(senders):
        log.attitude(i * 1e-3, 20 + i * 1e-3, sysid=sysid, compid=compid)
    return Decoder(DIALECT, stamped=True).push(log.close().read_bytes())


def made_up(count: int, begin: int = 0) -> list[tuple[int, int]]:
    return [(2 + i % 250, 1 + i // 250) for i in range(begin, begin + count)]


def test_few_are_all_heard(tmp_path: Path) -> None:
    frames = said(made_up(64) * 40, tmp_path)
    assert BusiestSenders().admit(frames) is frames


def test_in_a_crowd_those_are_heard_who_say_the_most(tmp_path: Path) -> None:
    """A vehicle that has a twentieth of the frames, and 20,000 made-up ones: it is never lost, and few others are."""
    crowd, others = BusiestSenders(), 0
    for k in range(20):
        mixed = made_up(1000, 1000 * k)
        for at in range(0, len(mixed), 20):
            mixed[at] = (1, 1)
        admitted = crowd.admit(said(mixed, tmp_path))
        vehicle = (admitted.sysid == 1) & (admitted.compid == 1)
        assert vehicle.sum() == 50
        others += int((~vehicle).sum())
    assert others < 500
    quiet = said([(1, 1), (7, 7)] * 500, tmp_path)
    for _ in range(30):
        admitted = crowd.admit(quiet)
    assert len(admitted) == len(quiet), "when the crowd has gone, everybody is heard again"


def test_a_stream_with_a_window_keeps_the_vehicle_and_forgets_the_crowd(tmp_path: Path) -> None:
    stream = Stream(window_s=5.0)
    for k in range(10):
        stream.add(said([*made_up(400, 400 * k), *[(1, 1)] * 100], tmp_path), 1.7e9 + k)
    assert len(stream.flights()) < 70
    assert (1, 1) in {(f.vehicle.sysid, f.vehicle.compid) for f in stream.recent(2.0)}
    assert stream.messages < 1500


def test_a_log_of_a_crowd_is_summed_up(tmp_path: Path) -> None:
    log = Writer(tmp_path / "crowd.tlog")
    for i, (sysid, compid) in enumerate([*made_up(3000), *[(1, 1)] * 20]):
        log.heartbeat(i * 1e-3, sysid=sysid, compid=compid)
        log.attitude(i * 1e-3, 20 + i * 1e-3, sysid=sysid, compid=compid)
    recording = read_recording(log.close())
    assert len(recording.flights) == MOST_SENDERS
    assert recording.unread_senders == 3001 - MOST_SENDERS
    first = recording.flights[0]
    assert (first.vehicle.sysid, first.messages["ATTITUDE"].count) == (1, 20)
    assert np.isfinite(first.duration)
