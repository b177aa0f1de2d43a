"""What is judged live is the batch: the best estimate over its window is that of a log of the same data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.app.live import HORIZON_S, Judge, new_stream
from companion.estimation import smooth
from companion.mavlink import DEFAULT_DIALECT, Decoder, load_dialect
from companion.model import Flight
from companion.strapdown import quaternion
from companion.verdict import Band, Verdict
from tests.recordings import BUNDLED

pytestmark = pytest.mark.slow

SEEN_S = 75.0  # of the recording, when it is judged
LASTING = ("HEARTBEAT", "PARAM_VALUE", "AUTOPILOT_VERSION", "GPS_GLOBAL_ORIGIN", "HOME_POSITION")
"""True for long: the live judge remembers them, so the log has them from its beginning."""


def test_the_estimate_over_the_live_window_is_that_of_a_log_of_the_same_data(tmp_path: Path) -> None:
    dialect = load_dialect(DEFAULT_DIALECT)
    log = (BUNDLED / "copter-demo-100hz.tlog").read_bytes()
    frames = Decoder(dialect, stamped=True).push(log)
    stamp = frames.stamp.astype(np.int64)
    seen = stamp <= stamp[0] + round(1e6 * SEEN_S)
    judged = list[Flight]()

    def judging(flight: Flight, _imu: str | None) -> tuple[Verdict, Band]:
        judged.append(flight)
        return Verdict("consistent", "", ()), ()

    judge = Judge(judging, new_stream(DEFAULT_DIALECT))
    pieces = np.split(np.flatnonzero(seen), np.arange(7, int(seen.sum()), 7))  # some frames at a time, as from a link
    for piece in pieces:
        packets = b"".join(frames.data[frames.start[i] : frames.start[i] + frames.size[i]].tobytes() for i in piece)
        judge.receive(packets, float(stamp[piece[-1]]) * 1e-6)
    judge.judge()
    (live,) = judged

    arrived = np.repeat([stamp[piece[-1]] for piece in pieces], [len(piece) for piece in pieces])
    lasting = np.isin(frames.id[seen], [dialect.by_name[name].id for name in LASTING])
    kept = np.flatnonzero(seen)[lasting | (arrived >= arrived[-1] - round(1e6 * HORIZON_S))]
    cut = tmp_path / "window.tlog"
    cut.write_bytes(b"".join(log[frames.offset[i] - 8 : frames.offset[i] + frames.size[i]] for i in kept))
    (batch,) = c.open_log(cut)

    now, then = smooth(live), smooth(batch)
    assert now.t[-1] - now.t[0] > 0.9 * HORIZON_S
    np.testing.assert_allclose(now.t, then.t, atol=1e-6)
    sigma = np.sqrt(np.diagonal(then.covariance, axis1=1, axis2=2))  # (K, 9)
    turned = quaternion.log(quaternion.multiply(now.q_ned_frd, quaternion.conjugate(then.q_ned_frd)))
    apart = np.hstack([turned, now.velocity - then.velocity, now.position - then.position])
    assert (np.abs(apart) < 0.01 * sigma).all()
    np.testing.assert_allclose(np.sqrt(np.diagonal(now.covariance, axis1=1, axis2=2)), sigma, rtol=0.01)
