"""Real start-ups: while the estimator aligns nobody is accused, whatever it does."""

from __future__ import annotations

import lzma

import pytest

from companion.app.examination import assess_imu
from companion.app.live import Judge, new_stream
from companion.app.settings import Settings
from companion.mavlink import DEFAULT_DIALECT, Decoder, load_dialect
from tests.recordings import recording

pytestmark = pytest.mark.slow


def test_an_estimator_that_aligns_on_the_pad_is_not_judged() -> None:
    """ArduCopter's first 28 s: the heading slews from -19.8° to -3° without any gyro."""
    data = lzma.decompress(recording("ap_faults/boot_pad_first28s.tlog.xz").read_bytes())
    judge = Judge(
        lambda flight, imu: (assess_imu(flight, Settings(), imu=imu).verdict, ()), new_stream(DEFAULT_DIALECT)
    )
    decoder = Decoder(load_dialect(), stamped=True)
    said = []
    for begin in range(0, len(data), 40_000):
        frames = decoder.push(data[begin : begin + 40_000])
        packets = [frames.data[i : i + n].tobytes() for i, n in zip(frames.start, frames.size, strict=True)]
        for i in range(0, len(packets), 20):  # some at a time, as a link hands them over
            judge.receive(b"".join(packets[i : i + 20]), float(frames.stamp[i : i + 20][-1]) * 1e-6)
        said.append(judge.judge())
    assert "starting" in [live_verdict.status for live_verdict in said]
    assert {live_verdict.status for live_verdict in said} <= {"starting", "insufficient_data", "consistent", ""}
    assert said[-1].status == "starting"
    assert "the estimator is aligning" in said[-1].text
    assert said[-1].alarms == ()
