"""The place on Earth of a telemetry log that begins before the vehicle knows it."""

from __future__ import annotations

from pathlib import Path

import pytest

import companion as c
from tests.tlogs import Writer

SEA = 584_000  # mm
HERE = {"lat": -353632621, "lon": 1491652370}
NOWHERE = {"lat": -349722477, "lon": 1475159052}  # as a receiver without a fix tells it
UNKNOWN = {"eph": 120, "epv": 120, "vel": 0, "cog": 0, "satellites_visible": 3}


@pytest.mark.parametrize("is_fused", [True, False])
def test_the_place_is_the_first_that_was_measured(tmp_path: Path, is_fused: bool) -> None:
    """ArduPilot's messages from switching on: heights count from there until its estimate has an origin."""
    log = Writer(tmp_path / "log.tlog")
    for i in range(100):
        t, known = 0.1 * i, i >= 50
        ms = round((10 + t) * 1e3)
        log.heartbeat(t)
        log.raw_imu(t, 10 + t)
        log.attitude(t, 10 + t)
        place = {**(HERE if known else NOWHERE), "alt": SEA if known else 577_000}
        log.send(t, "gps_raw_int", time_usec=ms * 1000, fix_type=3 if known else 1, **place, **UNKNOWN)
        if is_fused:
            fused = {**(HERE if known else {"lat": 3083, "lon": -1123}), "alt": SEA if known else 100}
            log.send(t, "global_position_int", time_boot_ms=ms, **fused, relative_alt=0, vx=0, vy=0, vz=0, hdg=0)
            log.send(t, "local_position_ned", time_boot_ms=ms, x=0, y=0, z=0, vx=0, vy=0, vz=0)
    found = c.open_log(log.close())[0].origin
    assert found is not None
    assert found.height == pytest.approx(SEA * 1e-3)
    assert found.t == pytest.approx(15.0, abs=0.1)
