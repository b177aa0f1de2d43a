"""YAML for other tools: the findings as annotations of PX4's Flight Review, an IMU's noise as Kalibr's imu.yaml.

Annotations: one interval a finding, on Flight Review's boot clock.
The format is version 1 of docs/annotations.md in PX4/flight_review (app/plot_app/annotations.py): sources with
categories, each of which names a plot and has intervals. Flight Review has no field for the severity: it stands before
the text, and the worst of a category is its colour. Texts above its limits are cut here, between words, and of too many
findings the least serious are left out.

imu.yaml: github.com/ethz-asl/kalibr, wiki "Yaml formats" and "IMU Noise Model".

"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from companion.comparison import ImuNoise, noise_model
from companion.export.table import Format
from companion.model import words
from companion.verdict import Finding, Verdict, by_severity

_MOST_TEXT, _MOST_NAME, _MOST_INTERVALS, _MOST_CATEGORIES = 200, 64, 1000, 50  # of Flight Review
_SEVERITY_COLOURS = {"error": "#d55e00", "warning": "#e69f00", "info": "#0072b2"}
_GRAPHS = (  # words of a kind of finding → the plot that shows it, by its title in Flight Review
    (("gps", "position", "ekf_reset", "altitude", "baro"), "Local Position X"),
    (("heading", "yaw", "compass", "magnet"), "Yaw Angle"),
    (("attitude", "tilt"), "Roll Angle"),
    (("gyro", "rate"), "Raw Angular Speed (Gyroscope)"),
)
_DEFAULT_GRAPH = "Raw Acceleration"


def write_annotations(path: Path, verdict: Verdict) -> list[Path]:
    """The findings, those of one kind in one category: of two with one name Flight Review would keep the last.

    Without any: a file with an empty list.
    """
    path.write_text("\n".join(_lines(verdict)) + "\n", encoding="utf-8")
    return [path]


def _lines(verdict: Verdict) -> Iterator[str]:
    """YAML, every text as a JSON string, which YAML reads as it is: nothing in it can be taken for markup."""
    yield f"# {_text(verdict.summary)}"
    yield "version: 1"
    findings = sorted(by_severity(verdict.findings)[:_MOST_INTERVALS], key=lambda f: (f.kind, f.start_s))
    if not findings:
        yield "sources: []"
        return
    yield "sources:"
    yield '  - name: "companion"'
    yield "    annotations:"
    kinds = [list(group) for _, group in groupby(findings, key=lambda f: f.kind)]
    for group in kinds[:_MOST_CATEGORIES]:
        kind, severity = group[0].kind, by_severity(group)[0].severity
        yield f"      - category: {_quoted(_cut(words(kind), _MOST_NAME))}"
        yield f"        graph: {_quoted(graph_of(kind))}"
        yield f"        color: {_quoted(_SEVERITY_COLOURS[severity])}"
        yield "        intervals:"
        for finding in group:
            yield from _interval(finding)


def _interval(finding: Finding) -> Iterator[str]:
    start, end = clock(finding.start_s), clock(max(finding.end_s, finding.start_s))
    yield f'          - start: "{start}"'
    if end != start:
        yield f'            end: "{end}"'
    yield f"            annotation: {_quoted(_cut(f'{finding.severity}: {finding.evidence}', _MOST_TEXT))}"


def clock(seconds: float) -> str:
    """Seconds of the boot clock as Flight Review labels its axis: [h:]mm:ss, with milliseconds.

    >>> clock(68.25), clock(3605.0), clock(-0.4)
    ('1:08.250', '1:00:05.000', '0:00.000')
    """
    minutes, ms = divmod(max(round(seconds * 1000), 0), 60_000)
    hours, minutes = divmod(minutes, 60)
    rest = f"{ms / 1000:06.3f}"
    return f"{hours}:{minutes:02d}:{rest}" if hours else f"{minutes}:{rest}"


def graph_of(kind: str) -> str:
    """The plot of Flight Review that shows a kind of finding, by its title."""
    return next((graph for words, graph in _GRAPHS if any(word in kind for word in words)), _DEFAULT_GRAPH)


def _cut(text: str, most: int) -> str:
    return textwrap.shorten(_text(text), most, placeholder="…")


def _quoted(text: str) -> str:
    """As JSON, and characters as they are: JSON's pairs of escapes for one beyond 16 bits are two in YAML."""
    return json.dumps(text, ensure_ascii=False)


def _text(text: str) -> str:
    """One line, printable: it may hold what a vehicle sent."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


FORMATS = (
    Format(
        "annotations",
        "the findings for PX4's Flight Review (YAML)",
        lambda path, c: write_annotations(path, c.assessment.verdict),
    ),
)


def kalibr_text(noise: ImuNoise, origin: str) -> str:
    """The text of imu.yaml. Kalibr's densities are those of `strapdown`: a sample at rate r has the deviation N √r."""
    gyro, accel = noise_model(noise)
    lines = [f"# IMU noise of {noise.imu} from {_text(origin)}"]
    for title, name, sensor, unit in (
        ("Accelerometers", "accelerometer", accel, "m/s^2"),
        ("Gyroscopes", "gyroscope", gyro, "rad/s"),
    ):
        lines += [
            f"# {title}",
            f"{name}_noise_density: {sensor.white.value:.4e}  # {unit}/sqrt(Hz): {sensor.white.source}",
            f"{name}_random_walk: {sensor.walk.value:.4e}  # {unit}/sqrt(s): {sensor.walk.source}",
        ]
    lines += ["rostopic: /imu0  # the topic of your bag", f"update_rate: {noise.rate_hz:.1f}  # Hz"]
    return "\n".join(lines) + "\n"
