"""The IMUs: the constant errors that explain the flight, side by side, their noise and spectra, and vibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from companion import present
from companion.comparison import PARTS, Calibration, ImuNoise, RedundantImu, RestNoise, imu_noise
from companion.model import Array, DataError, counted
from companion.noise import AllanDeviation, Spectrum, imu_spectrum, vibration
from companion.present import (
    CALIBRATED,
    QUANTITIES,
    SENSORS,
    by_best_estimate,
    capitalised,
    density,
    held_out_gain,
    html_table,
    interval,
    level_force,
    not_observable,
    palette,
    paragraph,
    redundant_imus_table,
    short,
    table,
    text,
    words,
)
from companion.report import traces
from companion.report.subject import Subject
from companion.report.traces import AXES
from companion.verdict import clip_counts


def calibration(subject: Subject) -> str:
    """Fitted errors with their standard errors, and what they gain."""
    fit = subject.assessment.calibration
    if fit is None:
        return paragraph("Not made: too few windows of 5 s, or none that can be fitted.")
    rows = [[part.title, _values(fit, name), part.unit] for name, part in CALIBRATED.items() if fit.score(name)]
    shown = table(["error", "± one standard error", ""], rows, name="calibration-table", words=3) if rows else ""
    if unknown := not_observable(fit):
        shown += paragraph(f"Not observable in this flight: {', '.join(unknown)}.")
    if by_best := by_best_estimate(fit):
        shown += paragraph(f"By the best estimate rather than the windows: {', '.join(by_best)}.")
    if level := level_force(fit):
        shown += paragraph(f"At 1 g the accelerometer's down axis is off by {level}.")
    if (held_out := held_out_gain(subject.assessment)) is not None:
        shown += paragraph(
            f"Median drift in {counted(held_out.windows, 'window')} of the second half, with the calibration of the "
            f"first: {held_out}."
        )
    if subject.assessment.made_worse:
        warning = "It makes the rest of the flight worse: the errors are not constant. Do not use it."
        shown += paragraph(warning, "warning")
    if panels := _intervals(fit):
        figure = traces.stack(panels, "", type="category", categoryorder="array", categoryarray=list(present.AXES))
        figure["layout"] |= {"showlegend": False, "hovermode": "closest"}
        caption = f"From {fit.windows} windows of {fit.horizon_s:g} s. Bars: ± two standard errors."
        shown += subject.charts.add(figure, caption, rows=0.75 * len(panels))
    return shown


def redundant_imus(subject: Subject) -> str:
    """Every IMU through the same windows."""
    others = subject.examined.redundant_imus
    if len(others) < 2:
        return paragraph("This flight has one IMU message with enough samples.")
    shown = html_table(redundant_imus_table(others), "imus-table")
    known = [other for other in others if other.drift.attitude_deg]
    if not known:
        return shown
    drawn = [q for q in QUANTITIES if q.name != "velocity" and any(getattr(o.drift, q.attribute) for o in known)]
    panels = [traces.Panel(q.title, [_bars(known, q.attribute, subject.colours)]) for q in drawn]
    figure = traces.stack(panels, "", type="category")
    figure["layout"] |= {"hovermode": "closest", "bargap": 0.5, "showlegend": False}
    seconds = others[0].drift.horizon_s
    caption = f"Drift after {seconds:g} s: bar to the median, line to 95 %. This report is about {subject.imu}."
    return shown + subject.charts.add(figure, caption)


def _values(fit: Calibration, name: str) -> str:
    """The parameters of a part one after the other, and what those that are not observable go together with."""
    part, place = CALIBRATED[name], PARTS[name]
    words_of = []
    for i, axis in zip(range(place.start, place.stop), part.axes, strict=True):
        value = part.shown(fit.values[i], fit.sigma[i])
        if not fit.observable[i]:
            other = fit.confounded[i]
            value = "not observable" + (f" (not separable from {words(other)})" if other else "")
        words_of.append(f"{axis} {value}".strip())
    return ", ".join(words_of)


def _intervals(fit: Calibration) -> list[traces.Panel]:
    """The vectors that are observable, each with a unit of its own."""
    panels = []
    for name, part in CALIBRATED.items():
        if part.axes is not present.AXES or not fit.score(name):
            continue
        first = PARTS[name].start
        seen = [k for k in range(3) if fit.observable[first + k]]
        points = traces.markers(
            [AXES[k][0] for k in seen],
            [fit.values[first + k] * part.factor for k in seen],
            part.title,
            error_y={
                "array": [2 * fit.sigma[first + k] * part.factor for k in seen],
                "thickness": 1.5,
                "color": palette.css(palette.CURSOR),
            },
            marker={"size": 9, "color": [palette.css(AXES[k][1]) for k in seen]},
            hovertemplate="%{x}: %{y:.3~g} ± %{error_y.array:.2~g} (2σ)",
        )
        panels.append(traces.Panel(f"{part.title},<br>{part.unit}", [points], {"zeroline": True}))
    return panels


def _bars(others: Sequence[RedundantImu], attribute: str, colours: Mapping[str, palette.Rgb]) -> traces.Trace:
    statistics = [getattr(other.drift, attribute) for other in others]
    median = [s.median if s else 0.0 for s in statistics]
    return {
        "type": "bar",
        "x": [text(other.imu) for other in others],
        "y": median,
        "error_y": {
            "array": [s.p95 - m if s else 0.0 for s, m in zip(statistics, median, strict=True)],
            "color": palette.css(palette.DIFFERENCE),
            "symmetric": False,
            "arrayminus": [0.0] * len(median),
        },
        "name": attribute,
        "width": 0.35,
        "marker": {"color": [palette.css(colours[o.imu]) for o in others]},
        "hovertemplate": "%{x}: %{y:.3~g}",
    }


def noise(subject: Subject) -> str:
    """White noise of each axis at rest, in flight and by the data sheet; the Allan deviation of the longest rest."""
    spec, limits = subject.assessment.imu_spec, subject.comparison.how.limits
    try:
        measured = imu_noise(subject.flight, subject.imu, spec, limits)
    except DataError as error:
        return paragraph(f"Not known: {error}")
    rows = []
    for sensor in SENSORS:
        sheet = short(getattr(spec, sensor.key).noise_density * sensor.factor)
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
        traces.Panel(
            f"{key}, {unit}", _curves(curve, getattr(measured.imu_spec, key).noise_density), traces.LOGARITHMIC
        )
        for key, unit in (("gyro", "rad/s"), ("accel", "m/s²"))
        if ((curve := getattr(rest, key)).deviation > 0).any()
    ]
    if not panels:
        return ""
    caption = (
        f"Overlapping Allan deviation of {measured.imu} over a rest of {rest.duration_s:.0f} s "
        f"({rest.start_s:.0f} to {rest.end_s:.0f} s). Dashed: the white noise of {measured.imu_spec.name}, which falls "
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


_VIBE_LIMIT = 30.0  # m/s²: ArduPilot's wiki, "Measuring Vibration": below 30 is normally fine
_FEWEST_HZ = 20.0


def spectra(subject: Subject) -> str:
    """Power spectral densities beside the sensor's own noise."""
    comparison, spec = subject.comparison, subject.assessment.imu_spec
    spectrum = imu_spectrum(comparison.track, subject.longest_step)
    if spectrum is None:
        return paragraph("Not drawn: no stretch without a gap is long enough for a spectrum (32 samples).")
    figure = traces.densities(
        lambda sensor: _densities(spectrum, getattr(spectrum, sensor), getattr(spec, sensor).noise_density)
    )
    caption = (
        f"Amplitude density of {comparison.track.source} by Welch's method, two-sided as N is: mean of "
        f"{spectrum.segments} segments of {1 / spectrum.frequency_hz[1]:.2g} s. Grey: the white noise of "
        f"{spec.name}. What moves faster than {spectrum.frequency_hz[-1]:.0f} Hz is folded into what is shown."
    )
    return subject.charts.add(figure, caption, rows=3) + _side_by_side(subject, spectrum)


def _side_by_side(subject: Subject, own: Spectrum) -> str:
    """The spectra of every IMU, all axes together; nothing where there is one IMU. own: of the one that was used."""
    used, limits = subject.comparison.track, subject.comparison.how.limits
    by_imu = {
        name: spectrum
        for name, track in subject.flight.imus.items()
        if (spectrum := own if track is used else imu_spectrum(track, limits.longest_step(track.t))) is not None
    }
    if len(by_imu) < 2:
        return ""

    def lines(sensor: str) -> list[traces.Trace]:
        densities = {name: np.sqrt(0.5 * getattr(one, sensor)[1:].sum(axis=1)) for name, one in by_imu.items()}
        return [
            traces.line(by_imu[name].frequency_hz[1:], density, text(name), subject.colours[name])
            for name, density in densities.items()
        ]

    caption = "Every IMU beside the others, root of the sum over its axes."
    return subject.charts.add(traces.densities(lines), caption, rows=3)


def shaking(subject: Subject) -> str:
    """Vibration over the flight: the vehicle's own measure, and what the IMU's samples show of it."""
    if charts := _reported(subject) + _measured(subject):
        return charts
    rate = subject.comparison.track.rate_hz
    why = f"{rate:.1f} Hz is too slow" if rate < _FEWEST_HZ else "no stretch without a gap is long enough"
    return paragraph(f"Not drawn: the vehicle did not report its vibration, and {why} to see it in {subject.imu}.")


def _reported(subject: Subject) -> str:
    """The vehicle's own measure, and the number of readings at an accelerometer's limit; "" without any."""
    series = subject.flight.series.get("vibration")
    names = [name for name in ("x_mps2", "y_mps2", "z_mps2", "accel_mps2") if series and name in series.columns]
    if series is None or not names or len(series) < 2:
        return ""
    titles = [("all axes", subject.colour)] if len(names) == 1 else AXES
    lines = [traces.line(series.t, series[name], *title) for name, title in zip(names, titles, strict=True)]
    clips = [counter.readings for counter in clip_counts(series)]
    caption = f"The vehicle's own measure ({series.source})."
    if len(names) == 3:
        caption += f" Below {_VIBE_LIMIT:.0f} m/s² is normally fine for ArduPilot."
    if clips:
        caption += f" An accelerometer was at its limit {_often(sum(clips))}."
    return _over_time(subject, "vibration, m/s²", lines, caption)


def _often(times: float) -> str:
    return "never" if times == 0 else "once" if times == 1 else f"{times:.0f} times"


def _measured(subject: Subject) -> str:
    """Vibration in the samples; "" where they do not show it."""
    seen = vibration(subject.comparison.track, subject.longest_step)
    if seen is None:
        return ""
    caption = (
        f"Specific force of {subject.imu} above 5 Hz, RMS of each second. ArduPilot's VIBE is the same "
        "from the IMU at its full rate: what the stream's low-pass and rate have lost is missing here."
    )
    return _over_time(subject, "above 5 Hz, m/s²", traces.by_axis(seen.t, seen.accel), caption)


def _over_time(subject: Subject, title: str, lines: list[traces.Trace], caption: str) -> str:
    panel = traces.Panel(title, lines, {"rangemode": "tozero"})
    return subject.charts.add(traces.stack([panel], traces.TIME), caption, rows=1.5)


def _densities(spectrum: Spectrum, power: Array, sheet: float) -> list[traces.Trace]:
    used = slice(1, None)  # a logarithmic axis has no zero
    frequency = spectrum.frequency_hz[used]
    lines = traces.by_axis(frequency, np.sqrt(0.5 * np.maximum(power[used], 1e-30)), limit=2048)
    floor = traces.curve(frequency[[0, -1]], np.full(2, sheet), "data sheet", palette.CURSOR, line={"dash": "dash"})
    return [*lines, floor]
