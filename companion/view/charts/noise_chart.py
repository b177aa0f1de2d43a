"""Noise of the IMU that is shown: spectra in flight over frequency, Allan deviation at rest over averaging time."""

from __future__ import annotations

import numpy as np

from companion.analysis import AxisNoise, ImuNoise
from companion.estimation import AllanDeviation
from companion.model import STANDARD_GRAVITY, Array
from companion.present import AXES, palette
from companion.view.charts.chart import DASHED
from companion.view.charts.log_charts import LineStyle

TITLES = (
    "Gyro in flight, mdps/√Hz over Hz",
    "Accelerometer in flight, µg/√Hz over Hz",
    "Gyro at rest, Allan deviation, mdps over s",
    "Accelerometer at rest, Allan deviation, µg over s",
)
STYLES: tuple[LineStyle, ...] = (
    *((name, colour, 1.5, None) for name, colour in zip(AXES, palette.AXES, strict=True)),
    ("data sheet", palette.CURSOR, 1.4, DASHED),
)
_MDPS, _MICRO_G = 1e3 * float(np.degrees(1.0)), 1e6 / STANDARD_GRAVITY
_POINTS = 200  # of a spectrum, evenly spread over the decades: the strongest bin of each


def noise_lines(noise: ImuNoise | None) -> list[tuple[Array, ...] | None]:
    """For each title x, the three axes and the data sheet's white noise; None where there is nothing to show.

    An axis that is below quantisation at rest is drawn at its upper bound.
    """
    if noise is None:
        return [None] * len(TITLES)
    gyro, accel = noise.figures.gyro.noise_density, noise.figures.accel.noise_density
    spectrum, rest = noise.flight.spectrum if noise.flight else None, noise.rest
    return [
        _spectrum(spectrum.frequency_hz, spectrum.gyro, gyro, _MDPS) if spectrum else None,
        _spectrum(spectrum.frequency_hz, spectrum.accel, accel, _MICRO_G) if spectrum else None,
        _allan(rest.gyro, rest.gyro_axes, gyro, _MDPS) if rest else None,
        _allan(rest.accel, rest.accel_axes, accel, _MICRO_G) if rest else None,
    ]


def _spectrum(frequency: Array, power: Array, sheet: float, factor: float) -> tuple[Array, ...]:
    """As two-sided amplitude densities: white noise of density N is N in them."""
    edges = np.unique(np.geomspace(1, len(frequency), _POINTS).astype(np.int64))[:-1]
    strongest = np.maximum.reduceat(power, edges, axis=0)
    lines = factor * np.sqrt(0.5 * strongest).T
    return (frequency[edges], *lines, np.full(len(edges), factor * sheet))


def _allan(
    curve: AllanDeviation, axes: tuple[AxisNoise | None, ...], sheet: float, factor: float
) -> tuple[Array, ...] | None:
    """None where every axis is stuck; one of them lies at the bottom of the chart."""
    fall = 1.0 / np.sqrt(curve.tau)
    lines = [
        axis.white.high * fall if axis is not None and axis.hidden else curve.deviation[:, i]
        for i, axis in enumerate(axes)
    ]
    seen = np.array(lines)[np.array(lines) > 0]
    if not len(seen):
        return None
    return (curve.tau, *(factor * np.maximum(line, 0.1 * seen.min()) for line in lines), factor * sheet * fall)
