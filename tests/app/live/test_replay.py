"""Live, both poses are those that the replay of the recording shows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.app.live import LiveReplay
from companion.mavlink import Decoder, load_dialect
from companion.simulate import Faults, SimulatedVehicle, fly, write_flight
from companion.telemetry import Stream

pytestmark = pytest.mark.slow

STREAMS = {"RAW_IMU": 100.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}


def streamed(path: Path, seconds: float, faults: Faults = Faults()) -> bytes:  # noqa: B008  (frozen)
    write_flight(SimulatedVehicle(fly(seconds, faults=faults), streams=STREAMS, faults=faults), path)
    return path.read_bytes()


def test_what_is_shown_live_is_what_the_replay_shows(tmp_path: Path) -> None:
    data = streamed(tmp_path / "a.tlog", 25.0)
    (flight,) = c.open_log(tmp_path / "a.tlog")
    stream, decoder = Stream(window_s=60.0), Decoder(load_dialect(), stamped=True)
    live = LiveReplay(stream, reanchor_s=5.0)
    whole = None
    compared = gone_on = 0
    for at in range(0, len(data), 1500):
        stream.add(decoder.push(data[at : at + 1500]))
        now = live.look()
        if now is None or now.replay.anchors[0] == now.replay.t[-1]:
            continue
        whole = whole or c.replay(flight, reanchor_s=5.0, start_s=float(now.replay.anchors[0]))
        i = int(np.searchsorted(whole.t, now.replay.t[-1]))
        assert whole.t[i] == now.replay.t[-1]
        # the last sample is one-sided until the next has come, hence not to the last digit
        np.testing.assert_allclose(now.replay.q_imu[-1], whole.q_imu[i] * sign(now, whole, i), atol=1e-5)
        np.testing.assert_allclose(now.replay.position_imu[-1], whole.position_imu[i], atol=1e-3)
        np.testing.assert_allclose(now.replay.position_ref[-1], whole.position_ref[i], atol=1e-9)
        compared += 1
        gone_on += now.continued is not None
    assert compared > 100
    assert gone_on > compared / 2, "most looks go on from the last at everything"


def sign(now: object, whole: c.Replay, i: int) -> float:
    """q and -q are one attitude."""
    return float(np.sign(now.replay.q_imu[-1] @ whole.q_imu[i]))  # type: ignore[attr-defined]


def test_a_reboot_is_a_new_flight_in_the_same_session(tmp_path: Path) -> None:
    data = streamed(tmp_path / "a.tlog", 40.0, Faults(reboot=(20.0,)))
    stream, decoder = Stream(window_s=60.0), Decoder(load_dialect(), stamped=True)
    live = LiveReplay(stream, reanchor_s=5.0)
    boots = []
    for at in range(0, len(data), 3000):
        stream.add(decoder.push(data[at : at + 3000]))
        if now := live.look():
            boots.append(now.flight.boot)
            assert np.abs(now.replay.position_error).max() < 3.0
    assert sorted(set(boots)) == [1, 2]
    assert boots == sorted(boots)


def test_where_nothing_can_be_shown_the_reason_is_said() -> None:
    stream = Stream()
    live = LiveReplay(stream)
    assert live.look() is None
    assert live.why_not == "no vehicle on the link"
    vehicle = SimulatedVehicle(fly(5.0), streams={"ATTITUDE": 50.0})
    stream.push(b"".join(packet for _, packet in vehicle.advance(3.0)), 1.7e9)
    assert live.look() is None
    assert live.why_not == "no IMU messages"
    with pytest.raises(c.SettingsError, match="positive seconds"):
        LiveReplay(stream, reanchor_s=0.0)
