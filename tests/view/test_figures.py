"""What the page draws and says of the analysis: the ellipsoid, home, rates and gaps, verdict."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.comparison import GENERIC, FlightNoise, Limits, imu_noise
from companion.model import STANDARD_GRAVITY, GpsTrack, Origin
from companion.noise import imu_spectrum
from companion.present import of_imus
from companion.strapdown import ImuModel, Sensor, motions, quaternion, simulate
from companion.verdict import Finding, Verdict
from companion.view import AnalysisResult, ReplayChoice
from companion.view.panels import verdict
from companion.view.panels.chart_pages import drift_lines, noise_lines, rates
from companion.view.panels.markup import banner
from companion.view.scene.drone import Ellipsoid, semi_axes
from companion.view.state.places import gps_path, home_position
from tests.flights import flight_of, seconds
from tests.view.circles import examine, make_flight, recompute

FLIGHT = make_flight()


@functools.cache
def result() -> AnalysisResult:
    return examine(FLIGHT, ReplayChoice(), recompute(FLIGHT, ReplayChoice()))


@given(st.integers(0, 10_000))
def test_the_semi_axes_give_the_covariance_back(seed: int) -> None:
    root = np.random.default_rng(seed).normal(size=(3, 3))
    covariance = root @ root.T
    axes, turn = semi_axes(covariance)
    corners = quaternion.rotate(np.broadcast_to(turn, (3, 4)), np.diag(axes))
    np.testing.assert_allclose(corners.T @ corners, covariance, atol=1e-9 * max(1.0, float(np.trace(covariance))))


def test_three_standard_deviations_are_drawn() -> None:
    handle = SimpleNamespace(visible=False)
    drawn = Ellipsoid(SimpleNamespace(add_icosphere=lambda *_, **__: handle), "", (0, 0, 0))  # type: ignore[arg-type]
    drawn.shown = True
    drawn.shape(np.diag([1.0, 4.0, 25.0]), np.zeros(3))
    assert sorted(handle.scale) == pytest.approx([3.0, 6.0, 15.0])


def test_home_is_where_the_latitudes_say() -> None:
    zero = Origin(np.radians(47.0), np.radians(8.0), 400.0)
    home = Origin(np.radians(47.001), np.radians(8.001), 390.0)
    flight = replace(FLIGHT, origin=zero, home=home)
    place = home_position(flight)
    assert place is not None
    assert place == pytest.approx([111.18, 76.06, 10.0], abs=0.05)  # m of a 0.001° at 47° north (GeographicLib)
    assert FLIGHT.position is not None
    there = replace(flight, origin=replace(zero, t=float(FLIGHT.position.t[700])))
    moved = home_position(there)
    assert moved is not None
    assert moved - place == pytest.approx(FLIGHT.position.position[700])
    assert home_position(replace(flight, home=None)) is None


def test_gps_fixes_lie_where_their_latitudes_say_and_only_in_three_dimensions() -> None:
    n = 5
    metres = np.full((n, 3), 1.0)
    gps = GpsTrack(
        t=np.arange(100.0, 100.0 + n), latitude=np.radians(47.0) + 1e-6 * np.arange(n),
        longitude=np.full(n, np.radians(8.0)),
        height=np.full(n, 410.0), velocity=metres, horizontal_sigma=metres[:, 0], vertical_sigma=metres[:, 0],
        speed_sigma=metres[:, 0], fix_type=np.array([2, 3, 3, 4, 0]), satellites=np.full(n, 9),
    )  # fmt: skip
    flight = replace(FLIGHT, origin=Origin(np.radians(47.0), np.radians(8.0), 400.0), gps=(gps,))
    path = gps_path(flight)
    assert path is not None
    assert path.t.tolist() == [101.0, 102.0, 103.0]
    assert np.diff(path.position[:, 0]) == pytest.approx(6.367, abs=0.005)  # m of a microradian of latitude at 47°
    assert path.position[:, 2] == pytest.approx(-10.0)
    assert gps_path(replace(flight, origin=None)) is None
    assert gps_path(replace(flight, gps=())) is None


def test_rates_and_gaps_are_those_of_the_messages() -> None:
    t = np.concatenate([np.arange(0.0, 40.0, 0.1), np.arange(45.0, 100.0, 0.1)]) + 0.05
    found = rates(t, 0.0, 100.0, bins=50)
    assert found.hz[0] == pytest.approx(10.0)
    assert found.gap_s.max() == pytest.approx(5.1)
    assert (found.hz[20:22] == 0).all()
    assert (found.gap_s[20:23] > 5).all()  # in every stretch that the gap reaches into
    assert found.gap_s[5] == pytest.approx(0.1)


def test_the_charts_show_the_drift_table() -> None:
    found = result().assessment
    lines = drift_lines(found, "position_m")
    assert lines is not None
    rows = [(row, e) for row, e in zip(found.drift.rows, found.expected, strict=True) if row.position_m and e]
    assert lines[0].tolist() == [row.horizon_s for row, _ in rows]
    assert lines[1].tolist() == [row.position_m.median for row, _ in rows if row.position_m]
    assert lines[3] == pytest.approx([e.position_m for _, e in rows])


def test_a_calibration_is_shown_in_the_units_of_its_rows() -> None:
    values = np.zeros(28)
    values[:10] = [2e-3, 0.0, 0.0, 0.4, 0.0, 0.0, 0.0, np.radians(-3.0), 0.0, 0.012]
    fit = SimpleNamespace(
        values=values, sigma=np.abs(values) / 2.0, observable=[True] * 28, windows=9, horizon_s=5.0, correction=None
    )
    found: Any = SimpleNamespace(calibration=fit, corrected=None, uncorrected=None, made_worse=False)
    table = re.sub("</?span[^>]*>", "", verdict.calibration_table(found)).replace("&nbsp;", " ")
    rows = dict(re.findall(r"<td>([^<]+)</td>((?:<td>[^<]*</td>)+)", table))
    assert "<td>2.00 ± 1.00</td>" in rows["gyro, mrad/s"]
    assert "<td>0.40 ± 0.20</td>" in rows["accel, m/s²"]
    assert "<td>0.00 ± 0.00</td><td>-3.00 ± 1.50</td>" in rows["mounting, °"]
    assert "<td>12.0 ± 6.0</td>" in rows["lag, ms"]


def test_no_text_becomes_markup() -> None:
    evil = "<img src=x onerror=alert(1)>"
    finding = Finding("frozen", "imu", "error", 1.0, 2.0, evil, evil)
    found = replace(result().assessment, verdict=Verdict("imu_suspect", evil, (finding,)))
    drift = replace(found.drift, imu=evil)
    sibling = [replace(s, imu=evil) for s in (*result().redundant_imus, *result().redundant_imus)]
    colours = of_imus([evil])
    markup = banner("imu_suspect", evil) + verdict.drift_table(drift, found, colours[evil], 5.0)
    markup += verdict.redundant_imus_table(sibling, colours) + verdict.calibration_table(found)
    assert "<img" not in markup
    assert "&lt;img" in markup


def test_the_noise_charts_are_the_spectrum_and_the_allan_deviation() -> None:
    """White noise lies on the data sheet's line in all four, in the convention of N."""
    motion = motions.rest(seconds(60, 100))
    model = ImuModel(Sensor(GENERIC.gyro.noise_density), Sensor(GENERIC.accel.noise_density))
    resting = simulate(motion.imu, model, 1)
    flight = flight_of(motion, imus={"RAW_IMU": replace(resting, source="RAW_IMU")})
    found = imu_noise(flight, "RAW_IMU", GENERIC, Limits())
    nothing, _, gyro, accel = noise_lines(found)
    assert nothing is None, "it never flew"
    for chart in (gyro, accel):
        assert chart is not None
        tau, *axes, sheet = chart
        assert len(tau) == len(sheet)
        for axis in axes:
            assert np.median(axis / sheet) == pytest.approx(1.0, rel=0.1)
    assert noise_lines(None) == [None] * 4
    spectrum = imu_spectrum(resting, 0.1)
    assert spectrum is not None
    shaking = replace(found, flight=FlightNoise(60.0, spectrum, None, None, (), ()))
    in_flight = noise_lines(shaking)[0]
    assert in_flight is not None
    frequency, forward, *_, sheet = in_flight
    assert frequency[0] > 0
    assert np.median(forward[frequency < 2] / sheet[0]) == pytest.approx(1.0, rel=0.2)
    sheets = replace(
        GENERIC,
        gyro=replace(GENERIC.gyro, noise_density=np.radians(0.02)),
        accel=replace(GENERIC.accel, noise_density=50e-6 * STANDARD_GRAVITY),
    )
    for i, chart in enumerate(noise_lines(replace(shaking, imu_spec=sheets))):
        assert chart is not None
        line = chart[-1] * (np.sqrt(chart[0]) if i > 1 else 1.0)  # N/√τ is the deviation of white noise
        np.testing.assert_allclose(line, 50.0 if i % 2 else 20.0)  # µg/√Hz, mdps/√Hz
