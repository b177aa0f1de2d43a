"""A live session on a real link: the numbers that it shows are those of `companion analyze` on its recording."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

import companion as c
from companion.analysis import Integration
from companion.live import Attachment, Watch
from companion.mavlink import Link, Recorder, Session
from companion.model import InputError
from companion.simulate import Faults
from tests.mavlink.peers import serial_cable
from tests.simulated import flying
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
                watching.hear(attachment.fetch())
                watching.look()
                return vehicle.t > 28.0

            wait_for(flown)
        watching.hear(attachment.fetch())
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


def test_another_imu_and_another_integrator_begin_anew() -> None:
    watching = watch()
    with Link("udpin:127.0.0.1:0") as link, Attachment(Session(link)) as attachment, flying(link.port, since=20.0):

        def looked(imu: str, windows: int) -> bool:
            watching.hear(attachment.fetch())
            seen = watching.look()
            watching.judge()
            counted = watching.drift[0].windows if watching.drift else 0
            return seen is not None and seen.present.imu == imu and seen.free is not None and counted >= windows

        wait_for(lambda: looked("HIGHRES_IMU", 2))
        free = watching.look()
        assert free is not None
        begun = free.free
        assert begun is not None

        def anchored_again() -> bool:
            looked("HIGHRES_IMU", 2)
            seen = watching.look()
            return seen is not None and bool(seen.present.replay.anchors[-1] > begun.anchor_s)

        wait_for(anchored_again)
        watching.choose("RAW_IMU", lambda _: Integration(method="euler"))
        assert watching.drift == ()
        wait_for(lambda: looked("RAW_IMU", 1))
        again = watching.look()
        assert again is not None
        assert again.free is not None
        assert again.free.anchor_s > begun.anchor_s
        euler = again.present.replay
        watching.choose("RAW_IMU", lambda _: Integration(method="rk4"))
        rk4 = watching.look()
        assert rk4 is not None
        shared = np.intersect1d(euler.t, rk4.present.replay.t)
        there = [r.position_imu[np.searchsorted(r.t, shared)] for r in (euler, rk4.present.replay)]
        assert np.abs(there[0] - there[1]).max() > 1e-6, "another integrator ends elsewhere"


def test_two_vehicles_do_not_take_turns_and_can_be_switched() -> None:
    watching = watch()
    with Link("udpin:127.0.0.1:0") as link, Attachment(Session(link)) as attachment:
        streams = {"RAW_IMU": 50.0, "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 20.0}
        with (
            flying(link.port, sysid=1, since=8.0, streams=streams),
            flying(link.port, sysid=2, since=8.0, streams=streams),
        ):
            seen: set[str] = set()

            def look() -> bool:
                watching.hear(attachment.fetch())
                found = watching.look()
                if found is not None:
                    seen.add(str(found.present.flight.vehicle))
                return len(watching.vehicles) == 2

            wait_for(lambda: look() and seen)
            until = time.monotonic() + 1.0
            while time.monotonic() < until:
                look()
            (first,) = seen
            other = next(vehicle for vehicle in watching.vehicles if vehicle != first)
            watching.pick(other)
            seen.clear()
            wait_for(lambda: look() and other in seen)


def test_what_ends_the_links_thread_is_raised_where_it_is_asked_for(tmp_path: Path) -> None:
    with serial_cable(tmp_path / "ttyUSB0") as cable, Link(f"{tmp_path}/ttyUSB0:9600", patience_s=0.1) as link:
        attachment = Attachment(Session(link))
        os.write(cable, bytes(500))
        wait_for(lambda: attachment.report is not None and not attachment.alive)
        with pytest.raises(InputError, match="500 bytes and not one MAVLink frame"):
            attachment.check()
        attachment.close()
