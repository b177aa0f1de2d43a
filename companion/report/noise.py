"""Noise of the IMU: Allan deviation at rest, white noise in flight, beside its data sheet."""

from __future__ import annotations

import numpy as np

from companion.analysis import ImuNoise, RestNoise
from companion.estimation import AllanDeviation
from companion.present import SENSORS, capitalised, density, interval, palette, paragraph, short, table
from companion.report import traces
from companion.report.subject import AXES, Subject


def noise(subject: Subject) -> str:
    """White noise of each axis at rest, in flight and by the data sheet; the Allan deviation of the longest rest."""
    measured = subject.noise
    if isinstance(measured, str):
        return paragraph(f"Not known: {measured}")
    rows = []
    for sensor in SENSORS:
        sheet = short(getattr(measured.figures, sensor.key).noise_density * sensor.factor)
        resting = getattr(measured.rest, f"{sensor.key}_axes", (None, None, None))
        flying = getattr(measured.flight, sensor.key) if measured.flight else None
        for i, (axis, _) in enumerate(AXES):
            rest = interval(getattr(resting[i], "white", None), sensor.factor)
            flight = density(flying, i, sensor.factor) if flying else "-"
            rows.append([f"{sensor.name} {axis}", rest, flight, sheet, f"{sensor.unit}/√Hz"])
    body = table(["white noise N", "at rest", "in flight", "data sheet", ""], rows, name="noise-table", words=1)
    if measured.rest is not None:
        body += _allan_chart(subject, measured, measured.rest)
    return body + "".join(paragraph(f"{capitalised(note)}.") for note in measured.notes)


def _allan_chart(subject: Subject, measured: ImuNoise, rest: RestNoise) -> str:
    panels = [
        traces.Panel(f"{key}, {unit}", _curves(curve, getattr(measured.figures, key).noise_density), {"type": "log"})
        for key, unit in (("gyro", "rad/s"), ("accel", "m/s²"))
        if ((curve := getattr(rest, key)).deviation > 0).any()
    ]
    if not panels:
        return ""
    caption = (
        f"Overlapping Allan deviation of {measured.imu} over a rest of {rest.duration_s:.0f} s "
        f"({rest.start_s:.0f} to {rest.end_s:.0f} s). Dashed: the white noise of {measured.figures.name}, which falls "
        "as 1/√τ; where the curve turns flat is the bias instability, where it rises the random walk."
    )
    return subject.charts.add(traces.stack(panels, "averaging time τ, s", type="log"), caption, rows=3)


def _curves(curve: AllanDeviation, sheet: float) -> list[traces.Trace]:
    lines = [
        traces.curve(curve.tau, np.maximum(curve.deviation[:, i], 1e-12), name, colour)
        for i, (name, colour) in enumerate(AXES)
        if (curve.deviation[:, i] > 0).any()
    ]
    white = traces.curve(curve.tau, sheet / np.sqrt(curve.tau), "data sheet", palette.CURSOR, line={"dash": "dash"})
    return [*lines, white]
