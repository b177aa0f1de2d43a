"""The head of the page: the verdict in a sentence, and what was flown with what."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np

from companion.analysis import Verdict, rate_warning
from companion.app.recording import Source
from companion.model import Flight
from companion.present import (
    QUANTITIES,
    capitalised,
    clause,
    flight_words,
    palette,
    paragraph,
    short,
    text,
    vehicle_words,
    words,
)
from companion.report.subject import Subject
from companion.view import worst_stretch

_NO_BREAK = "\N{NO-BREAK SPACE}"  # between a number and its unit
_SHOWN_S = 5.0  # the horizon of which the median is shown


def head(subject: Subject, ground: str) -> str:
    """HTML of the title, the verdict and its numbers; ground: the chart that stands beside them, "" for none."""
    flight, verdict, rate = subject.flight, subject.assessment.verdict, subject.comparison.track.rate_hz
    tracks = {"attitude": flight.attitude, "position": flight.position}
    against = ", ".join(track.source if track else f"no {name}" for name, track in tracks.items())
    cards = "".join(
        f'<div class="card"><b>{text(value)}</b><span>{text(label)}</span></div>' for label, value in _cards(subject)
    )
    flights = "".join(paragraph(f"Flight {i}, {flight_words(one)}") for i, one in enumerate(verdict.flights, 1))
    banner = _banner(verdict.status, verdict.summary) + flights
    body = f'{banner}<div class="cards">{cards}</div>{_warning(flight, rate)}'
    title = _title(flight, subject.source, f"{subject.imu} at {rate:.1f} Hz against {against}")
    return f"<header>{title}{_beside(body, ground)}</header>"


def bare_head(flight: Flight, source: Source, verdict: Verdict, ground: str) -> str:
    """The same for a flight that cannot be examined."""
    body = _banner(verdict.status, verdict.summary)
    return f"<header>{_title(flight, source, '')}{_beside(body, ground)}</header>"


def _beside(body: str, ground: str) -> str:
    """The verdict, and the ground track beside it where the window is wide enough."""
    return f'<div class="first"><div>{body}</div>{ground}</div>' if ground else body


def _title(flight: Flight, source: Source, used: str) -> str:
    """The log's name, and under it who flew when."""
    vehicle = flight.vehicle
    who = (f"Vehicle {vehicle}, boot {flight.boot}", vehicle_words(vehicle))
    parts = [*who, _date(flight), f"{flight.duration:.1f} s", used]
    return f'<h1>{text(source.path.name)}</h1><p class="quiet">{text(" · ".join(filter(None, parts)))}</p>'


def _banner(status: str, summary: str) -> str:
    title = f"{palette.SIGNS[status]} {text(capitalised(words(status)))}"
    sentence = capitalised(re.sub(r"(?<=\d) (?=%)", _NO_BREAK, clause(summary)))
    return f'<div class="verdict {text(status)}" id="verdict"><h2>{title}</h2><p>{text(sentence)}</p></div>'


def _date(flight: Flight) -> str:
    """When the flight began; "" where that is not known."""
    if flight.epoch is None:
        return ""
    try:
        began = datetime.fromtimestamp(flight.epoch.unix_s + flight.start, UTC)
    except (OverflowError, ValueError, OSError):  # a damaged clock
        return ""
    return f"{began:%Y-%m-%d %H:%M:%S} UTC ({flight.epoch.source})"


def _cards(subject: Subject) -> list[tuple[str, str]]:
    """The few numbers that a reader wants first: the worst, what was expected there, when; then what is usual.

    The share of windows inside their bound is not among them: the verdict has it, of the windows that it judges.
    """
    cards = _worst(subject)
    drift = zip(subject.assessment.drift.rows, subject.assessment.expected, strict=True)
    rows = [(row, should) for row, should in drift if row.windows]
    if not rows:
        return cards
    row, should = min(rows, key=lambda pair: abs(pair[0].horizon_s - _SHOWN_S))
    measured, expected = [], []
    for quantity in QUANTITIES:
        statistic, sigma = getattr(row, quantity.attribute), getattr(should, quantity.attribute, None)
        if statistic is not None:
            unit = quantity.after.replace(" ", _NO_BREAK)
            measured.append(f"{short(statistic.median)}{unit}")
            expected.append("" if sigma is None else f"{short(sigma)}{unit}")
    cards.append((f"after {row.horizon_s:g} s on the IMU alone, median of {row.windows}", ", ".join(measured)))
    if all(expected):
        cards.append(("expected then, 1σ", ", ".join(expected)))
    return cards


def _worst(subject: Subject) -> list[tuple[str, str]]:
    """Where IMU and autopilot are farthest apart, and how far they should be there."""
    shown = subject.replay
    worst = worst_stretch(shown) if shown is not None else None
    if shown is None or worst is None:
        return []
    alone = worst.end_s - worst.start_s
    cards = [
        ("farthest apart", f"{short(worst.apart_m)} m"),
        (f"seconds since boot, {alone:.1f} s on the IMU alone", f"at {worst.end_s:.1f} s"),
    ]
    expected = subject.expected
    if expected is not None:
        sigma = float(np.interp(worst.end_s, expected.t, expected.lengths[2]))
        if sigma > 0:
            cards.insert(1, (f"expected there, 1σ; {worst.apart_m / sigma:.1f} times that", f"{short(sigma)} m"))
    return cards


def _warning(flight: Flight, rate_hz: float) -> str:
    warning = rate_warning(flight, rate_hz)
    return f'<p class="warning">{text(warning)}</p>' if warning else ""
