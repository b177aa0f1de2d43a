"""A flight without an IMU: what its autopilot, GPS and compass say of one another."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.comparison import Limits
from companion.model import EstimatorReset, Flight, StatusText, rows
from companion.strapdown import quaternion
from companion.verdict import Verdict, verdict_without_imu
from tests.flights import CIRCLE, flown, moved_north
from tests.recordings import recording

WHY = "no IMU message (found: none)."


def verdict(flight: Flight) -> Verdict:
    judged = verdict_without_imu(replace(flight, imus={}), WHY, Limits())
    assert judged is not None
    assert WHY in judged.summary
    return judged


def kinds(flight: Flight) -> set[str]:
    return {f.kind for f in verdict(flight).findings}


def shifted(flight: Flight, begin: float, end: float, north: float) -> Flight:
    """The autopilot's position so many m further north for a while, without a velocity that says so."""
    track = flight.position
    assert track is not None
    away = (track.t >= begin) & (track.t < end)
    return replace(flight, position=replace(track, position=track.position + away[:, None] * [north, 0.0, 0.0]))


def turned(flight: Flight, begin: float, angle: float) -> Flight:
    """The autopilot's attitude turned about the vertical from some time on, rad."""
    track = flight.attitude
    assert track is not None
    turn = quaternion.exp(np.where(track.t >= begin, angle, 0.0)[:, None] * np.array([0.0, 0.0, 1.0]))
    return replace(flight, attitude=replace(track, q_ned_frd=quaternion.multiply(turn, track.q_ned_frd)))


def test_what_agrees_is_said_and_nobody_is_cleared() -> None:
    said = verdict(flown(CIRCLE))
    assert said.status == "insufficient_data"
    assert said.findings == ()
    assert all(words in said.summary for words in ("position within", "velocity within", "heading within"))


def test_a_position_that_leaves_its_gps_and_jumps_back_is_the_autopilots() -> None:
    said = verdict(shifted(flown(CIRCLE), 25.0, 40.0, 60.0))
    assert said.status == "autopilot_suspect"
    assert said.cause is not None
    assert said.cause.kind == "position_jump"
    assert said.cause.size == pytest.approx(60.0, abs=3.0)
    assert said.cause.onset_s == pytest.approx(25.0, abs=0.2)


def test_a_gps_that_leaves_the_position_accuses_nobody() -> None:
    flight = flown(CIRCLE)
    (gps,) = flight.gps
    slowly = replace(flight, gps=(moved_north(gps, np.clip(gps.t - 25.0, 0.0, 20.0) * 2.0),))
    said = verdict(slowly)
    assert said.status == "insufficient_data"
    assert "gps_disagrees" in {f.kind for f in said.findings}


def test_a_receiver_without_a_fix_hides_no_other() -> None:
    """Autopilots number receivers as they are wired: the first may have none."""
    flight = shifted(flown(CIRCLE), 25.0, 40.0, 60.0)
    (gps,) = flight.gps
    searching = replace(gps, instance=1, fix_type=np.zeros_like(gps.fix_type))
    said = verdict(replace(flight, gps=(searching, gps)))
    assert (said.status, said.summary) == ("autopilot_suspect", verdict(flight).summary)


@pytest.mark.parametrize("angle", [0.8, -0.8])
def test_a_heading_that_steps_away_from_its_compass_accuses_nobody(angle: float) -> None:
    said = verdict(turned(flown(CIRCLE), 30.0, angle))
    assert said.status == "insufficient_data"
    assert {"heading_jump", "compass_disagrees"} <= {f.kind for f in said.findings}


def test_a_lost_position_and_resets_are_lines() -> None:
    flight = flown(CIRCLE, resets=(EstimatorReset(30.0, "heading", "heading reset by 5.0°"),))
    assert flight.position is not None
    track = flight.position
    kept = track.t < 45.0
    lost = replace(track, t=track.t[kept], position=track.position[kept], velocity=track.velocity[kept])
    assert {"position_lost", "estimator_reset"} <= kinds(replace(flight, position=lost))


@pytest.mark.parametrize(
    "without", [{"gps": ()}, {"compasses": ()}, {"attitude": None}, {"position": None}, {"position": None, "gps": ()}]
)
def test_whatever_is_left_is_judged(without: dict[str, Any]) -> None:
    assert verdict(replace(flown(CIRCLE), **without)).status == "insufficient_data"


def test_a_gps_of_which_nothing_is_left_speaks_against_nobody() -> None:
    """Every fix contradicts the one before; or there is none."""
    flight = flown(CIRCLE)
    gps = flight.gps[0]
    leaping = moved_north(gps, np.where(np.arange(len(gps)) % 2, 60.0, -60.0))
    assert "gps_inconsistent" in kinds(replace(flight, gps=(leaping,)))
    assert verdict(replace(flight, gps=(rows(gps, slice(0)),))).status == "insufficient_data"


@pytest.mark.parametrize(("changes", "says"), [({}, True), ({"velocity": np.nan}, False), ({"fix_type": 1.0}, False)])
def test_a_gps_moves_as_its_velocity_says_only_where_it_tells_one(changes: dict[str, float], *, says: bool) -> None:
    flight = flown(CIRCLE)
    (gps,) = flight.gps
    columns: dict[str, Any] = {name: np.full_like(getattr(gps, name), value) for name, value in changes.items()}
    said = verdict(replace(flight, gps=(replace(gps, **columns),)))
    assert ("the GPS moves as its own velocity says" in said.summary) is says


def test_where_nothing_is_left_there_is_no_verdict() -> None:
    bare = replace(flown(CIRCLE), imus={}, position=None, gps=(), compasses=(), barometers=())
    assert verdict_without_imu(bare, WHY, Limits()) is None


def test_a_ground_mag_anomaly_speaks_against_the_compass_whenever_it_was_said() -> None:
    text = "EKF3 IMU0 MAG0 ground mag anomaly, yaw re-aligned"
    flight = replace(turned(flown(CIRCLE), 45.0, 0.8), texts=(StatusText(11.0, 4, text),))
    (compass,) = (f for f in verdict(flight).findings if f.kind == "compass_disagrees")
    assert text in compass.evidence


@pytest.mark.slow
def test_a_recorded_gps_glitch_without_its_imu() -> None:
    flight = c.open_log(recording("sitl/copter-gps-glitch-50hz.tlog"))[0]
    said = verdict(flight)
    assert said.status == "autopilot_suspect"
    assert said.cause is not None
    assert said.cause.onset_s == pytest.approx(80.26, abs=0.1)
