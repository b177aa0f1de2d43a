"""Which reading of a sensor stands at which keyframe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.constants import healthy
from companion.estimation.aiding_sensors import SENSORS
from companion.estimation.iteration import start_of
from companion.estimation.learned_noise import FIRST_NOISE
from companion.estimation.linearisation import linearise, preintegrate_imu
from companion.estimation.readings import Intake, Readings
from companion.estimation.setup import set_up
from companion.model import STANDARD_GRAVITY, Array, GpsTrack, Origin, geodetic_from_ned
from companion.strapdown import motions
from tests.estimation.sensed import LATENCY, PLACE, at, gps_of, sensed, true_states, with_imu

SPACING = 0.4
T = np.concatenate([np.arange(0.0, 10.0, SPACING), np.arange(20.0, 30.0, SPACING)])
"""Keyframes, with a gap in which there are none."""


@pytest.mark.parametrize("rate", [0.7, 2.5, 10.0, 50.0])
@pytest.mark.parametrize("seed", range(3))
def test_each_keyframe_has_the_nearest_reading_within_half_a_spacing_and_each_reading_counts_once(
    rate: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    when = np.sort(rng.uniform(-1.0, 31.0, round(32 * rate)))
    found = SENSORS["barometer"].at_keyframes(when, when[:, None], T, SPACING)
    apart = np.abs(when[:, None] - T[found.keyframe])
    assert (found.t == when[apart.argmin(axis=0)]).all(), "the nearest of all"
    assert (np.abs(found.t - T[found.keyframe]) <= 0.5 * SPACING + 1e-3).all()
    assert (np.diff(found.keyframe) > 0).all()
    assert (np.diff(found.t) > 0).all()
    assert (found.value[:, 0] == found.t).all()
    near = np.abs(when[:, None] - T).min(axis=0) <= 0.5 * SPACING
    alone = np.ones(len(T), np.bool_)
    alone[found.keyframe] = False
    shared = np.isin(np.abs(when[:, None] - T).argmin(axis=0), np.searchsorted(when, found.t))
    assert (alone & near <= shared).all(), "who has none within reach shares it with another"


def fixes(t: Array) -> GpsTrack:
    return gps_of(motions.rest(t), np.random.default_rng(0), rate=1.0)


def fixed(track: GpsTrack) -> list[Readings]:
    flight, _ = sensed(30.0)
    intake = Intake(flight, flight.imu(), T, SPACING / 2, track, Origin(*PLACE), [])
    taken = [row.read(row, intake) for row in SENSORS.values() if row.device == "gps" and row.read is not None]
    return [one for one in taken if one is not None]


def test_a_fix_stands_where_the_vehicle_was_when_it_was_made() -> None:
    track = fixes(np.arange(0.0, 30.0, 0.01))
    for one in fixed(track):
        assert (np.abs(one.t - healthy.GPS_LATENCY_S - T[one.keyframe]) <= 0.5 * SPACING + 1e-3).all()
        assert not ((one.t > 10.3) & (one.t < 19.7)).any(), "no keyframe is near"


def test_a_fix_beside_a_gap_of_the_imu_is_where_the_velocity_leads() -> None:
    """At the true states a fix without noise leaves nothing, though no latency is learned there: 8 m/s are 0.8 m."""
    flight, truth = sensed(40.0, "circle", rate=50.0)
    (gps,) = flight.gps
    where = geodetic_from_ned(at(gps.t - LATENCY, truth.t, truth.position), PLACE)
    imu = flight.imu()
    kept = (imu.t < 15.0) | (imu.t > 17.0)
    cut = with_imu(flight, replace(imu, t=imu.t[kept], gyro=imu.gyro[kept], accel=imu.accel[kept]))
    exact = replace(gps, latitude=where[:, 0], longitude=where[:, 1], height=where[:, 2])
    setup = set_up(replace(cut, gps=(exact,)), None, STANDARD_GRAVITY, None)
    states = true_states(setup, flight, truth)
    scale = {one.name: 1.0 for one in setup.readings}
    linear = linearise(
        setup,
        preintegrate_imu(setup, (np.zeros(3), np.zeros(3))),
        states,
        FIRST_NOISE,
        scale,
        {},
        start_of(setup, states).slow,
    )
    left = next(one for one in linear.measurements if one.name == "gps_position")
    beside = np.isin(setup.t[left.keyframe], setup.t[np.flatnonzero(setup.broken)[:, None] + [0, 1]])
    assert beside.any()
    assert np.abs(left.residual).max() < 0.1


def test_what_a_receiver_says_of_itself_is_believed_down_to_centimetres() -> None:
    track = fixes(np.arange(0.0, 30.0, 0.01))
    vain = replace(track, horizontal_sigma=np.full(len(track), 1e-6), speed_sigma=np.full(len(track), 0.3))
    stated = {one.name: one.sigma for one in fixed(vain)}
    assert (stated["gps_position"] > 0.01).all()
    assert (stated["gps_velocity"] == 0.3).all()
