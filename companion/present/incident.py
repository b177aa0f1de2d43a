"""The seconds around an incident as text: Markdown for a forum post or an issue, and the lines that the page shares.

Texts of vehicles and names of files are untrusted. No place on Earth is shown: times are relative to the moment,
heights and distances to where the vehicle was then.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator

from companion.analysis import Incident, Output, ProbableCause
from companion.analysis import percent as probability
from companion.model import Flight, words
from companion.present.formats import capitalised, fixed, vehicle_words

CAUSES = {
    "mechanical": "a motor, propeller or ESC",
    "installation": "how it was put together: motor order, propellers, frame type, board orientation",
    "power": "the battery or its wiring",
    "imu": "the IMU",
    "aiding": "GPS, compass or barometer",
    "estimator": "the estimator by itself",
    "autopilot": "the estimator by itself",
    "command": "what was asked of it, by pilot or mission",
    "other": "none of these",
    "nobody": "no sensor and not the estimator",
    "gps": "the GPS",
}
"""Cause → in words."""

_MOMENTS = {
    "requested": "The requested moment",
    "loss_of_control": "Loss of control",
    "failsafe": "Failsafe",
    "cause": "The first fault",
    "lane_switch": "Lane switch",
}
_PLACE = re.compile(r"-?\d{1,3}\.\d{4,}")  # four decimals of a degree are 11 m: nothing else is written so finely
_LEAST = 0.01
_MOST_ROWS = 40


def heading(incident: Incident) -> str:
    """What the page is about, in a line: untrusted."""
    moment = incident.moment
    return f"{_MOMENTS[moment.kind]} at {moment.t:.1f} s: {clean(moment.text)}"


def clean(text: str) -> str:
    """A vehicle's text without what may be a place on Earth."""
    return _PLACE.sub("…", text)


def cause_lines(incident: Incident) -> Iterator[tuple[str, str, str]]:
    """Cause, probability, evidence: the likeliest first, those above 1 %."""
    for one in incident.causes:
        if one.probability >= _LEAST:
            yield capitalised(_cause(one)), probability(one.probability), clean("; ".join(one.evidence))


def _cause(one: ProbableCause) -> str:
    return CAUSES.get(one.name, f"the {words(one.name)}")


def facts(incident: Incident) -> Iterator[tuple[str, str]]:
    """What sensors, controller and motors did, in words."""
    for one in incident.imus:
        before = ""
        if math.isfinite(one.rate_before):
            before = f", before it {fixed(math.degrees(one.rate_before))}°/s and {fixed(one.force_before)} m/s²"
        yield one.imu, f"at most {fixed(math.degrees(one.rate))}°/s and {fixed(one.force)} m/s²{before}"
    tracking = incident.tracking
    if tracking is not None:
        left = "" if tracking.left_s is None else f", more than 30° from {tracking.left_s:+.2f} s on"
        yield (
            "Desired and achieved attitude",
            f"{math.degrees(tracking.before):.1f}° apart before it, {math.degrees(tracking.worst):.0f}° at most "
            f"({tracking.worst_s:+.2f} s){left}; a tilt of up to {math.degrees(tracking.desired):.0f}° was desired",
        )
    if incident.outputs:
        yield "Motors and servos", "; ".join(map(_output, incident.outputs))
    elif "motors and servos" not in incident.missing:
        yield "Motors and servos", "none at an end of its range that was not there before"
    yield "Not in the log", ", ".join(incident.missing)


def _output(one: Output) -> str:
    end = "full" if one.end == "full" else "lowest"
    return f"{one.name} at its {end} output from {one.since_s:+.2f} s on (usually {one.usual:.0%})"


def timeline(incident: Incident) -> Iterator[tuple[str, str, str]]:
    """Time, kind, text: untrusted. At most forty rows, those nearest to the moment."""
    nearest = sorted(incident.timeline, key=lambda row: abs(row.after_s))[:_MOST_ROWS]
    for row in sorted(nearest, key=lambda row: row.after_s):
        yield f"{row.after_s:+.2f} s", row.what, clean(row.text)


def incident_markdown(incident: Incident, flight: Flight, verdict: str, name: str) -> str:
    """The whole page in Markdown. name: of the log; verdict: the sentence of the analysis, "" for none."""
    before, after = incident.moment.t - incident.start_s, incident.end_s - incident.moment.t
    blocks = [
        f"## {_escaped(heading(incident))}",
        f"{_escaped(vehicle_words(flight.vehicle))}, log {_code(name)}; from {before:.0f} s before to {after:.0f} s "
        "after the moment. Times are relative to it.",
        *([f"**Sensors and estimator until then:** {_escaped(clean(verdict))}"] if verdict else []),
        "### Probable causes",
        _table(("cause", "probability", "what speaks for it"), cause_lines(incident)),
        "### What sensors and controls did",
        "\n".join(f"- **{_escaped(what)}**: {_escaped(said)}" for what, said in facts(incident)),
        "### Timeline",
        _table(("time", "", "text"), timeline(incident)),
        "_Made by `companion incident`. The probabilities weigh what each cause usually shows; they are no proof, and "
        "what is not in the log was not guessed._",
    ]
    return "\n\n".join(blocks) + "\n"


def _table(titles: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(map(_escaped, row))} |" for row in rows]
    return "\n".join([f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}", *lines]) if lines else "Nothing."


def _escaped(text: str) -> str:
    """Text in which Markdown and HTML see no marks, on one line."""
    printable = "".join(c if c.isprintable() else " " for c in text)
    return re.sub(r"([\\`*_{}\[\]<>#|~@])", r"\\\1", printable)


def _code(text: str) -> str:
    return "`" + "".join(c if c.isprintable() and c != "`" else " " for c in text) + "`"
