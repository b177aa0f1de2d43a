"""Findings about shaking: readings far noisier than the data sheet."""

from __future__ import annotations

from collections.abc import Iterator

from companion.analysis.comparison import Comparison
from companion.analysis.figures import ImuFigures
from companion.analysis.finding import Finding


def noise_findings(comparison: Comparison, measured: tuple[float, float], imu: ImuFigures) -> Iterator[Finding]:
    """Readings far noisier than the data sheet: vibration, or a simulator that shakes."""
    track = comparison.track
    for name, density, sheet, unit in (
        ("gyro", measured[0], imu.gyro.noise_density, "rad/s/√Hz"),
        ("accel", measured[1], imu.accel.noise_density, "m/s²/√Hz"),
    ):
        if density > 10.0 * sheet:
            yield Finding(
                f"{name}_noise",
                "imu",
                "warning",
                float(track.t[0]),
                float(track.t[-1]),
                f"{density:.2g} {unit} in flight, {density / sheet:.0f} times the {sheet:.2g} of {imu.name}",
                "Vibration reaches the sensor: look at VIBE and at the damping. The budget below allows for it.",
            )
