"""A live session on a real link: the numbers that it shows are those of `companion analyze` on its recording."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.app.live import Attachment, Watch
from companion.app.live.watch import LiveState
from companion.comparison import Integration
from companion.links import Link, Recorder, Session
from companion.mavlink import Decoder, load_dialect
from companion.model import InputError
from companion.simulate import Faults, SimulatedVehicle, fly
from tests.links.peers import serial_cable
from tests.simulated import bursts, flying
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

HORIZONS = (1.0, 2.0, 3.0)


def watch() -> Watch:
    return Watch(
        dialect="ardupilotmega", dequantise=False, how=lambda _: Integration(), horizons=HORIZONS, reanchor_s=5.0
    )


def test_the_drift_of_a_session_is_that_of_its_recording(tmp_path: Path) -> None:
    path, watching = tmp_path / "a.tlog", watch()
    faults = Faults(drop=0.05, duplicate=0.05, reorder=0.05, garbage=0.05)
    with Link("udpin:127.0.0.1:0") as link, Recorder(path) as recorder:
        session = Session(link, recorder=recorder)
        with flying(link.port, since=20.0, faults=faults, seed=5) as vehicle, Attachment(session) as attachment:

            def flown() -> bool:
                watching.receive(attachment.fetch())
                watching.look()
                return vehicle.t > 28.0

            wait_for(flown)
        watching.receive(attachment.fetch())
        seen = watching.look()
        watching.judge(settled=True)
    assert seen is not None
    (flight,) = c.open_log(path)
    table = c.drift(flight, imu=seen.present.imu, horizons=HORIZONS)
    for now, then in zip(watching.drift, table.rows, strict=True):
        assert now.windows == then.windows > 0
        assert dict(now.excluded) == dict(then.excluded)
        np.testing.assert_allclose(now.errors.anchor_s, then.errors.anchor_s)
        np.testing.assert_allclose(now.errors.position, then.errors.position, atol=1e-6)
        np.testing.assert_allclose(now.errors.attitude, then.errors.attitude, atol=1e-9)
        assert now.position_m is not None
        assert then.position_m is not None
        assert now.position_m.median == pytest.approx(then.position_m.median)


@contextlib.contextmanager
def hearing(*vehicles: SimulatedVehicle) -> Iterator[tuple[Watch, Callable[[float], LiveState | None]]]:
    """A watch that hears them from 20 s on, without a link or a clock, and what it sees after so many s."""
    watching, decoder = watch(), Decoder(load_dialect(), stamped=False)

    def seen_at(until: float) -> LiveState | None:
        sent = sorted(packets for vehicle in vehicles for packets in bursts(vehicle, until))
        watching.receive([(decoder.push(data), t) for t, data in sent])
        seen = watching.look()
        watching.judge()
        return seen

    for vehicle in vehicles:
        vehicle.advance(20.0)
    yield watching, seen_at


def test_another_imu_and_another_integrator_begin_anew() -> None:
    streams = {"HIGHRES_IMU": 50.0, "RAW_IMU": 50.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
    with hearing(SimulatedVehicle(fly(40.0), streams=streams)) as (watching, seen_at):
        before = seen_at(24.0)
        assert before is not None
        assert before.free is not None
        assert before.present.imu == "HIGHRES_IMU"
        later = seen_at(32.0)
        assert later is not None
        assert later.present.replay.anchors[-1] > before.free.anchor_s, "anchored again"
        assert watching.drift[0].windows >= 2
        watching.choose("RAW_IMU", lambda _: Integration(method="euler"))
        forgotten = watching.drift
        assert forgotten == ()
        again = seen_at(32.5)
        assert again is not None
        assert again.free is not None
        assert again.present.imu == "RAW_IMU"
        assert again.free.anchor_s > before.free.anchor_s
        assert watching.drift[0].windows >= 1
        euler = again.present.replay
        watching.choose("RAW_IMU", lambda _: Integration(method="rk4"))
        rk4 = watching.look()
        assert rk4 is not None
        shared = np.intersect1d(euler.t, rk4.present.replay.t)
        there = [r.position_imu[np.searchsorted(r.t, shared)] for r in (euler, rk4.present.replay)]
        assert np.abs(there[0] - there[1]).max() > 1e-6, "another integrator ends elsewhere"


def test_two_vehicles_do_not_take_turns_and_can_be_switched() -> None:
    streams = {"RAW_IMU": 50.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
    flown = fly(40.0)
    with hearing(*(SimulatedVehicle(flown, sysid=i, streams=streams) for i in (1, 2))) as (watching, seen_at):

        def shown(begin: float) -> set[str]:
            seen = [seen_at(begin + 0.2 * i) for i in range(10)]
            return {str(each.present.flight.vehicle) for each in seen if each is not None}

        (first,) = shown(22.0)
        assert len(watching.replay.vehicles) == 2
        other = next(vehicle for vehicle in watching.replay.vehicles if vehicle != first)
        watching.replay.vehicle = other
        assert shown(24.0) == {other}


def test_what_ends_the_links_thread_is_raised_where_it_is_asked_for(tmp_path: Path) -> None:
    with serial_cable(tmp_path / "ttyUSB0") as cable, Link(f"{tmp_path}/ttyUSB0:9600", patience_s=0.1) as link:
        attachment = Attachment(Session(link))
        os.write(cable, bytes(500))
        wait_for(lambda: attachment.report is not None and not attachment.alive)
        with pytest.raises(InputError, match="500 bytes and not one MAVLink frame"):
            attachment.check()
        attachment.close()
