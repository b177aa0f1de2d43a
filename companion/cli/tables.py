"""Tables and text of the commands, in a terminal of 80 columns: verdicts, drift, and the errors of the sensor."""

from __future__ import annotations

import argparse
import re
import textwrap
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any

import numpy as np
import rich.console
import rich.text
from rich import box
from rich.markup import escape
from rich.table import Table

from companion import present
from companion.comparison import PARTS, Alignment, Calibration
from companion.documents import Document, encode
from companion.model import Array, counted
from companion.verdict import Assessment, Verdict

_STATUS = {"consistent": "green", "imu_suspect": "red", "autopilot_suspect": "red", "insufficient_data": "yellow"}
_NO_BREAK = "\N{NO-BREAK SPACE}"
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:m|s|Hz|%|ms|m/s|m/s²|mrad/s|mrad|µT)(?![\w/]))")
SIGNS = {"error": "[red]✗[/]", "warning": "[yellow]![/]", "info": "·"}


class Console(rich.console.Console):
    """A terminal, a pipe or a file."""

    def render_str(self, text: str, **how: Any) -> rich.text.Text:
        """Names of files, and what vehicles say, may hold what a terminal obeys."""
        return super().render_str(present.sanitised(text), **how)

    def on_broken_pipe(self) -> None:
        """Leave it to `main`: rich would exit with 1, which means "suspect" here."""
        raise BrokenPipeError

    def lines(self, *parts: str | Table) -> None:
        """Each on a line of its own, as it is."""
        for part in parts:
            self.print(part, highlight=False, no_wrap=isinstance(part, Table) or None)


def console() -> Console:
    """For results: no emoji codes in names like 1:100:, no folding of long lines."""
    return Console(soft_wrap=True, emoji=False)


def show(arguments: argparse.Namespace, lines: Iterable[str | Table], document: Callable[[], Document]) -> None:
    """The results as lines, or with --json the document; only that which is shown is made."""
    if arguments.json:
        print(encode(document()))
    else:
        console().lines(*lines)


def verdict_lines(verdict: Verdict, *, most: int = present.MOST_LINES) -> Iterator[str]:
    """The verdict, each flight by itself where there are several, and the findings under it."""
    yield f"{status_text(verdict.status)}  {escape(present.clause(verdict.summary))}"
    yield from (f"  {escape(', '.join(flight))}" for flight in present.flight_lines(verdict))
    groups, left = present.ranked(verdict.findings, most)
    for group in groups:
        one = group.findings[0]
        named = f"{present.span(one)}: {present.words(one.kind)}. " if len(group.findings) == 1 else ""
        yield f"  {SIGNS[one.severity]} {named}{escape(str(group))}"
        if one.severity != "info":
            yield f"      {escape(group.worst.advice)}"
    if left:
        yield f"  and {left} more: --json has them all"


def wrapped(text: str, width: int, hanging: int) -> list[str]:
    """Text in lines of rich markup; all but the first are indented. A number and its unit stay together."""
    kept = _NUMBER_AND_UNIT.sub(_NO_BREAK, text)
    lines = textwrap.wrap(kept, width, subsequent_indent=" " * hanging, break_long_words=False, break_on_hyphens=False)
    return [escape(line.replace(_NO_BREAK, " ")) for line in lines] or [""]


def status_text(status: str) -> str:
    """CONSISTENT, IMU SUSPECT, ... in its colour."""
    return f"[bold {_STATUS[status]}]{present.words(status).upper()}[/]"


def table(*headings: str, left: int = 0) -> Table:
    """A table whose first `left` columns are text."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for i, heading in enumerate(headings):
        shown.add_column(heading, justify="left" if i < left else "right", no_wrap=True)
    return shown


def folded_table(*headings: str, numbers: Collection[int] = ()) -> Table:
    """A table of text, which is folded where it is too wide, never cut; numbers: the columns that are some."""
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    for i, heading in enumerate(headings):
        number = i in numbers
        shown.add_column(heading, justify="right" if number else "left", no_wrap=number, overflow="fold")
    return shown


def rendered(of: present.Table) -> Table:
    """A table of results; the columns of a group are columns within one of the terminal's."""
    groups = list(of.groups)
    has_groups = any(title for title, _ in groups)
    shown = table()
    for title, places in groups:
        names = [of.columns[i].title for i in places]
        head = _line(*(n if len(n) <= _WIDTH else f"{n[:3]}." for n in names)) if title else names[0]
        is_text = title or of.columns[places[0]].is_text
        heading = f"{title:^{len(head)}}\n{head}" if has_groups else head
        shown.add_column(heading, justify="left" if is_text else "right", no_wrap=bool(title), overflow="fold")
    for row in of.rows:
        cells = [_cell(cell) for cell in row]
        shown.add_row(*(_line(*(cells[i] for i in places)) if title else cells[places[0]] for title, places in groups))
    return shown


_WIDTH = 6
"""Characters of a number in a group: whatever its length, they stand under one another."""


def _cell(cell: present.Cell) -> str:
    return "-" if cell is None else present.fixed(cell) if isinstance(cell, float) else escape(str(cell))


def _line(*parts: str) -> str:
    return "".join(f"{part:>{_WIDTH}}" for part in parts)


_MOST_RESTS = 3


def noise_lines(assessment: Assessment) -> Iterator[str]:
    """White noise by the data sheet, at rest and in flight (worst axis), in the units of data sheets."""
    flying = assessment.measured_noise
    if not assessment.rests and flying.gyro is None and flying.accel is None:
        return
    for sensor in present.SENSORS:
        resting = [getattr(rest, f"{sensor.key}_noise") for rest in assessment.rests]
        sheet, moving = getattr(assessment.imu_spec, sensor.key).noise_density, getattr(flying, sensor.key)
        parts = [f"{present.fixed(sheet * sensor.factor)} {sensor.unit}/√Hz expected"]
        if still := [density for density in resting if density is not None]:
            parts.append(f"{present.fixed(min(still) * sensor.factor)} at rest")
        elif resting:
            parts.append("at rest: below quantisation")
        if moving is not None:
            parts.append(f"{present.fixed(moving * sensor.factor)} in flight")
        yield f"{'Noise:' if sensor is present.SENSORS[0] else '':<11}{sensor.name} {', '.join(parts)}"


def autopilot_line(assessment: Assessment) -> str:
    """The assumed error of the autopilot's own estimate."""
    own = assessment.autopilot
    return (
        f"Assumed autopilot error (1σ): tilt {_degrees(own.tilt)}, heading {_degrees(own.heading)}, "
        f"{present.fixed(own.velocity)} m/s, {present.fixed(own.position)} m ({escape(own.reason)})"
    )


def calibration_lines(assessment: Assessment) -> Iterator[str]:
    """The fitted errors with their standard errors, and whether they help on windows they were not fitted to."""
    fit = assessment.calibration
    if fit is None:
        return
    yield f"Calibration from {counted(fit.windows, 'window')} of {fit.horizon_s:g} s (± one standard error):"
    for part, shown in present.CALIBRATED.items():
        if fit.score(part):
            yield f"  {shown.title:<19}{_values(fit, part)} {shown.unit}"
            if part == "gyro_bias":
                yield from _other_estimates(assessment)
    if by_best := present.by_best_estimate(fit):
        yield f"  by the best estimate rather than the windows: {', '.join(by_best)}"
    if unknown := present.not_observable(fit):
        yield f"  not observable     in this flight: {', '.join(unknown)}"
    place = PARTS["accel_bias"]
    if any(fit.assumed[place]):
        best = zip(fit.correction.accel_bias, fit.assumed_sigma[place], fit.assumed[place], strict=True)
        parts = [f"{'xyz'[i]} {value:.3f} ± {sigma:.3f}" for i, (value, sigma, taken) in enumerate(best) if taken]
        yield f"  if mounting is 0   accelerometer bias {', '.join(parts)} m/s²"
    if level := present.level_force(fit):
        yield f"  at 1 g             z is off by {level}"
    if (gain := present.held_out_gain(assessment)) is not None:
        yield f"  out of sample      median of {counted(gain.windows, 'window')} of the second half, by the first"
        yield f"    autopilot's      {gain.by_autopilot}"
        if gain.by_best:
            yield f"    best estimate's  {gain.by_best}"
        if assessment.made_worse:
            yield "  [yellow]It makes the rest of the flight worse: the errors are not constant. Do not use it.[/]"


def _values(fit: Calibration, part: str) -> str:
    """The parameters of a part with their standard errors."""
    place = PARTS[part]
    return ", ".join(
        present.CALIBRATED[part].shown(value, sigma) if seen else "not observable"
        for value, sigma, seen in zip(fit.values[place], fit.sigma[place], fit.observable[place], strict=True)
    )


def _other_estimates(assessment: Assessment) -> Iterator[str]:
    """The gyro bias as the rests and the autopilot have it."""
    for rest in assessment.rests[:_MOST_RESTS]:
        bias = _plus_minus(rest.gyro, rest.gyro_sigma)
        yield f"    at rest          {bias} mrad/s ({rest.start_s:.1f}-{rest.end_s:.1f} s)"
    if (held := assessment.autopilot_bias) is not None:
        bias = _plus_minus(held.gyro, held.sigma)
        yield f"    the autopilot's  {bias} mrad/s ({held.start_s:.1f}-{held.end_s:.1f} s)"


def alignment_lines(alignment: Alignment) -> Iterator[str | Table]:
    """The alignment of the IMU at rest, and the distance of its attitude from the autopilot's later."""
    rest = alignment.rest
    yield f"\n[bold]The IMU alone, from rest[/] ({rest.start_s:.1f}-{rest.end_s:.1f} s)"
    heading = {"nothing": "unknown: taken as north"}.get(alignment.heading_from, f"from the {alignment.heading_from}")
    yield f"Roll and pitch from gravity (± {_degrees(alignment.tilt_sigma)} each), heading {heading}" + (
        f" (± {_degrees(alignment.heading_sigma)})" if alignment.heading_from != "nothing" else ""
    )
    yield f"Gyro bias  {_plus_minus(rest.gyro, rest.gyro_sigma)} mrad/s taken off"
    if alignment.magnetic_error_rad is not None:
        declination = "declination added" if alignment.declination_rad else "the declination is part of it"
        yield f"Magnetometer minus autopilot: {_degrees(alignment.magnetic_error_rad)} of heading ({declination})"
    for note in alignment.notes:
        yield f"Note:      {escape(note)}"
    if not alignment.later:
        yield "The autopilot's attitude is not known after the rest."
        return
    shown = table("after rest", "tilt °", "allowed, 1σ", "heading °", "allowed, 1σ")
    for row in alignment.later:
        errors = (row.tilt_deg, row.expected_tilt_deg, row.heading_deg, row.expected_heading_deg)
        shown.add_row(f"{row.since_s:.1f} s", *map(present.fixed, errors))
    yield shown


def _degrees(angle: float) -> str:
    return f"{np.degrees(angle):.1f}°"


def _plus_minus(values: Array, sigma: Array) -> str:
    """Biases of the gyro, rad/s, in mrad/s."""
    return ", ".join(map(present.CALIBRATED["gyro_bias"].shown, values, sigma))
