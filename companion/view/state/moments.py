"""What is worth a look: named instants, the errors beside what is allowed, where they are largest, where it opens."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Literal, get_args

import numpy as np

from companion.comparison import Integration, Replay, errors, expected_since_anchor, replay, trailing
from companion.model import Array, DataError, Event, Flight, StatusText, nearest, words
from companion.present import QUANTITIES
from companion.verdict import Assessment, Finding, Verdict, leading_doubt
from companion.view.state.trajectory import (
    AnalysisResult,
    DisplayTrajectory,
    errors_of,
    joined,
    with_result,
    worst_stretch,
)

MarkKind = Literal["finding", "arming", "mode", "trouble", "text", "anchor"]


@dataclass(frozen=True, slots=True)
class Mark:
    """A named instant. The label is untrusted text: it is escaped where it becomes markup."""

    t: float  # s, boot clock
    label: str
    kind: MarkKind = "text"


MOST_LABELS = 60  # characters of a label that are shown
_ARMING = re.compile(r"\b(dis)?arm(ed|ing)?\b", re.IGNORECASE)
_MODE = re.compile(r"\bmode\b", re.IGNORECASE)
_WARNING = 4  # MAV_SEVERITY_WARNING; smaller is worse


def marks_of(flight: Flight, findings: Sequence[Finding] = ()) -> list[Mark]:
    """Texts and events of the vehicle, and findings, sorted by time."""
    told = [Mark(text.t, text.text, _kind(text)) for text in flight.texts]
    told += map(_event_mark, flight.events)
    told += (Mark(one.start_s, finding_label(one), "finding") for one in findings)
    return sorted(told, key=lambda mark: mark.t)


def finding_label(finding: Finding) -> str:
    """Its kind and evidence: untrusted."""
    return f"{words(finding.kind)}: {finding.evidence}"


def _event_mark(event: Event) -> Mark:
    if event.kind == "mode":
        return Mark(event.t, f"mode {event.text}", "mode")
    kinds: dict[str, MarkKind] = {"armed": "arming", "disarmed": "arming", "error": "trouble"}
    return Mark(event.t, event.text, kinds.get(event.kind, "text"))


def short(label: str) -> str:
    """A label as it fits in a list: one line, printable, cut where it is too long."""
    line = "".join(c if c.isprintable() else " " for c in label).strip() or "(no words)"
    return line if len(line) <= MOST_LABELS else line[: MOST_LABELS - 1] + "…"


def _kind(text: StatusText) -> MarkKind:
    if _ARMING.search(text.text):
        return "arming"
    if _MODE.search(text.text):
        return "mode"
    return "trouble" if text.severity <= _WARNING else "text"


Error = Literal["attitude", "velocity", "position"]
ERRORS = dict(zip(get_args(Error), QUANTITIES, strict=True))
"""What can be off."""
BEFORE_S, PLAYED_S = 3.0, 10.0
"""How long before the onset of a cause what is played from the page's opening begins, and how long it lasts."""
AFTER_S = 3.0
"""How long after the strongest instant of a finding it is played to."""
LONG_S = 120.0
"""A log that lasts longer has more anchors than a strip can show: it has the error over the horizon in their place."""
_NEAR_S, _SAME_S = 0.5, 0.01  # s from where a moment is played from: its own anchor follows soon, or is there
_LAST_S = 5.0  # of the worst stretch, while there is no analysis
_SHOWS_IN: dict[str, Error] = {
    **dict.fromkeys(("gyro", "compass", "tilt", "heading", "declination", "mounting", "axes", "imu"), "attitude"),
    **dict.fromkeys(("accel", "velocity", "lever"), "velocity"),
    **dict.fromkeys(("gps", "position", "height", "barometer", "antenna", "dead"), "position"),
}
"""First word of a kind of finding → the error in which it shows; any other shows where the error is largest."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorCurve:
    """One error over time, and what is allowed of it."""

    error: Error
    t: Array  # (N,) s, boot clock
    values: Array  # (N,) in the unit of ERRORS
    allowed: Array  # (N,) one standard deviation; NaN where nothing is known of it
    horizon_s: float | None = None  # of the windows that end at t; None: since the anchor

    @property
    def sigmas(self) -> Array:
        """(N,) the error divided by what is allowed."""
        return np.asarray(self.values / self.allowed)


@dataclass(frozen=True, slots=True)
class Moment:
    """A stretch of a flight, and the instant in it that shows most. Times in s, boot clock."""

    error: Error
    onset_s: float
    end_s: float
    strongest_s: float
    of_finding: bool = True  # else the window with the largest error, of which nothing need be wrong
    is_slow: bool = False  # whether it does not show in what is played from before its onset

    @property
    def begins_s(self) -> float:
        """From where it is played: from before its onset on, of one that shows late up to its strongest instant."""
        return max(self.onset_s - BEFORE_S, self.strongest_s - PLAYED_S if self.is_slow else -np.inf)

    def begins_at(self, anchors: Array) -> float:
        """The same, at the anchor that is made for it: the sample that follows."""
        near = anchors[(anchors >= self.begins_s) & (anchors < self.begins_s + _NEAR_S)]
        return float(near[0]) if len(near) else self.begins_s

    def opens_at(self, display: DisplayTrajectory) -> float:
        """Where the page opens at it: where the error is largest of what is played, or at the end of a window."""
        if not self.of_finding:
            return self.strongest_s
        curve = since_anchor(display, self.error)
        begin = self.begins_at(display.replay.anchors)
        played = np.flatnonzero((curve.t >= max(self.onset_s, begin)) & (curve.t < begin + PLAYED_S))
        return float(curve.t[played[np.argmax(curve.values[played])]]) if len(played) else begin


def over_horizon(display: DisplayTrajectory, error: Error) -> ErrorCurve | None:
    """The error of the window that ends at each instant; None where there is none, or no analysis yet."""
    if (result := display.result) is None or not len(result.trailing.t):
        return None
    t, column = result.trailing.t, ERRORS[error].attribute
    allowed = np.full(len(t), getattr(result.allowed, column, None) or np.nan)
    return ErrorCurve(error, t, getattr(result.trailing, column), allowed, result.horizon_s)


def since_anchor(display: DisplayTrajectory, error: Error) -> ErrorCurve:
    """The error at every sample of the replay."""
    t, allowed, column = display.replay.t, np.full(len(display.replay.t), np.nan), ERRORS[error].attribute
    if (envelope := display.expected) is not None:
        allowed = np.interp(t, envelope.t, getattr(envelope, column))
    known = (allowed > 0) & display.replay.reference_valid  # across a gap the autopilot's state is interpolated
    return ErrorCurve(error, t, getattr(display.errors, column), np.where(known, allowed, np.nan))


def shown_curve(display: DisplayTrajectory, error: Error) -> ErrorCurve:
    """The one that a strip shows: since the anchor, and of a long log over the horizon."""
    curve = over_horizon(display, error) if display.end - display.start > LONG_S else None
    return curve or since_anchor(display, error)


def sigmas_along(display: DisplayTrajectory, t: Array) -> Array:
    """(N,) at times t (N,) s, the largest of the errors over the horizon about then, in σ; NaN where none is known."""
    most = np.full(len(t), np.nan)
    for error in errors_in(display):
        curve = over_horizon(display, error)
        if curve is None or curve.horizon_s is None:
            continue
        centre = curve.t - curve.horizon_s / 2
        near = np.abs(centre[nearest(centre, t)] - t) < curve.horizon_s / 2
        most = np.fmax(most, np.where(near, np.interp(t, centre, curve.sigmas), np.nan))
    return most


def errors_in(display: DisplayTrajectory) -> tuple[Error, ...]:
    """Those that a log can show."""
    return tuple(ERRORS) if display.replay.has_position else ("attitude",)


def moment_of(finding: Finding, display: DisplayTrajectory) -> Moment:
    """When a finding shows most, in σ of what is allowed, and in which error."""
    known, word = errors_in(display), finding.kind.partition("_")[0]
    shows = _SHOWS_IN.get(word)
    among = (shows,) if shows in known else known
    low, high = max(finding.start_s, display.start), min(finding.end_s, display.end)
    peak = _strongest((of(display, error) for error in among for of in (since_anchor, over_horizon)), low, high)
    error, t = (peak[0].error, peak[1]) if peak is not None else (among[-1], low)
    return Moment(error, finding.start_s, finding.end_s, t)


def _strongest(
    curves: Iterable[ErrorCurve | None], low: float = -np.inf, high: float = np.inf
) -> tuple[ErrorCurve, float] | None:
    """The one that is off by most σ of what is allowed between two times, s, and when; None where none is known."""
    peaks: list[tuple[float, ErrorCurve, float]] = []  # of each curve: σ, and when
    for curve in curves:
        if curve is not None:
            late = high + (curve.horizon_s or 1.0)  # what ends then was within
            inside = np.flatnonzero((curve.t >= low) & (curve.t <= late) & np.isfinite(curve.sigmas))
            if len(inside):
                at = inside[np.argmax(curve.sigmas[inside])]
                peaks.append((float(curve.sigmas[at]), curve, float(curve.t[at])))
    return max(peaks, key=itemgetter(0))[1:] if peaks else None


def cause_of(verdict: Verdict) -> Finding | None:
    """The finding that a verdict is about: that of its cause, else the first of those that leave it open."""
    if (cause := verdict.cause) is not None:
        faults = (f for f in verdict.findings if f.severity == "error")
        return min(faults, key=lambda f: abs(f.start_s - cause.onset_s), default=None)
    doubt = leading_doubt(verdict.findings)
    return doubt or next((f for f in verdict.findings if f.severity == "error"), None)


def _is_slow(moment: Moment, display: DisplayTrajectory) -> bool:
    """Whether no window that ends in what is played from before the onset on is off by more than is allowed."""
    curve = over_horizon(display, moment.error)
    if curve is None:
        return False
    early = (curve.t >= moment.onset_s) & (curve.t < moment.begins_s + PLAYED_S) & np.isfinite(curve.sigmas)
    return bool(early.any() and curve.sigmas[early].max() < 1.0)


def decisive(display: DisplayTrajectory) -> Moment | None:
    """Where the page opens: at the headline's cause, without one at the worst window; None where nothing differs."""
    cause = cause_of(display.result.assessment.verdict) if display.result is not None else None
    if cause is not None and display.start <= cause.end_s and cause.start_s <= display.end:
        moment = moment_of(cause, display)
        return replace(moment, is_slow=_is_slow(moment, display))
    if (peak := _strongest(over_horizon(display, error) for error in errors_in(display))) is not None:
        curve, end = peak
        return Moment(curve.error, end - (curve.horizon_s or 0.0), end, end, of_finding=False)
    stretch = worst_stretch(display.replay)
    if stretch is None:
        return None
    onset = max(stretch.start_s, stretch.end_s - _LAST_S)
    return Moment("position", onset, stretch.end_s, stretch.end_s, of_finding=False)


def anchored_at_opening(
    flight: Flight, display: DisplayTrajectory, imu: str | None, how: Integration, reanchor_s: float
) -> Replay | None:
    """The replay that is shown, anchored where the page's opening is played from as well.

    None where it is already, or begins there, and where the autopilot's state is not known from there on.
    """
    moment, before = decisive(display), display.replay
    if moment is None or moment.begins_s <= before.t[0] or np.abs(before.anchors - moment.begins_s).min() < _SAME_S:
        return None
    seen = flight.with_imu(display.track) if display.track else flight
    try:
        return joined(before, replay(seen, imu=imu, how=how, reanchor_s=reanchor_s, start_s=moment.begins_s))
    except DataError:
        return None


def analysed(
    flight: Flight, display: DisplayTrajectory, assessment: Assessment, horizon_s: float, reanchor_s: float | None
) -> AnalysisResult:
    """The analysis of what is shown, with the anchor where the page opens, and what is expected from there on."""
    comparison = assessment.comparison
    windows = errors(comparison, trailing(comparison, horizon_s))
    after_horizon = errors_of(windows.end_s, windows.attitude, windows.velocity, windows.position)
    result = AnalysisResult(assessment, after_horizon, horizon_s)
    anchored = None
    if reanchor_s is not None:
        opened = with_result(display, result)
        anchored = anchored_at_opening(flight, opened, display.source, comparison.how, reanchor_s)
    shown = anchored or display.replay
    expected = expected_since_anchor(comparison, assessment.imu_spec, assessment.autopilot, shown)
    return replace(result, expected=expected, replay=anchored)
