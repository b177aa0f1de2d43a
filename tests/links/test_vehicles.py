"""Latency and the vehicle's clock, from questions and answers whose truth is known."""

from __future__ import annotations

import time

import pytest

from companion.links import Link as RealLink
from companion.links import Session
from companion.links.vehicles import Clock, Timesync
from companion.mavlink import Decoder, Packer, load_dialect, split_messages
from tests.simulated import flying
from tests.waiting import wait_for

DIALECT = load_dialect()


def asked(
    sync: Timesync, seconds: float, *, begin: float = 1000.0, way: float = 0.04, ahead: float = 100.0, rate: float = 1.0
) -> Clock:
    """A vehicle whose clock is `ahead` s of ours and runs `rate` times as fast answers for a while."""
    packer, decoder, now = Packer(1, 1), Decoder(DIALECT, stamped=False), begin
    found = None
    while now < begin + seconds:
        if request := sync.next_request(now):
            theirs = int(1e9 * (ahead + 1000.0 + rate * (now + way / 2 - 1000.0)))
            packet = packer.pack("TIMESYNC", {"tc1": theirs, "ts1": request.fields["ts1"]})
            other = packer.pack("TIMESYNC", {"tc1": theirs + 7_000_000_000, "ts1": 12345})
            sync.receive(split_messages(decoder.push(other + packet), DIALECT)["TIMESYNC"], now + way)
        found = sync.clock(now, unix=5000.0 + now)
        now += 0.1
    assert found is not None
    return found


def test_the_way_there_and_back_is_halved() -> None:
    clock = asked(Timesync(), 30.0)
    assert clock.latency_ms == pytest.approx(20.0)
    assert clock.booted == pytest.approx(5000.0 - 100.0, abs=0.01)
    assert clock.rate_ppm is None, "too early to say"


def test_a_clock_that_runs_slow_is_seen() -> None:
    assert asked(Timesync(), 200.0, rate=0.992).rate_ppm == pytest.approx(-8000.0, rel=0.1)


def test_a_step_begins_anew() -> None:
    sync = Timesync()
    asked(sync, 30.0)
    clock = asked(sync, 30.0, begin=1030.0, ahead=160.0)
    assert clock.booted == pytest.approx(5000.0 - 160.0, abs=0.01)


def test_nothing_is_known_before_an_answer() -> None:
    sync = Timesync()
    assert sync.next_request(0.0) is not None
    assert sync.next_request(0.5) is None
    assert sync.clock(1.0, 2.0) is None


def test_a_simulated_vehicle_on_a_real_link() -> None:
    with RealLink("udpin:127.0.0.1:0") as link:
        session = Session(link)
        with flying(link.port, since=20.0) as vehicle:
            wait_for(lambda: session.step(0.02) is not None and session.report().clock is not None)
            clock = session.report().clock
            assert clock is not None
            assert clock.latency_ms > 0.0
            assert clock.booted == pytest.approx(time.time() - vehicle.t, abs=10.0), "and not when it was met"
