"""The page: one HTML file that asks nobody for anything."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

import msgspec

from companion.documents import encode
from companion.examination import Examination
from companion.recording import Source
from companion.report import drift, facts, flown, sensors, shaking
from companion.report.charts import Charts
from companion.report.findings import findings
from companion.report.markup import text
from companion.report.playback import playback
from companion.report.subject import Section, subject_of
from companion.report.summary import head
from companion.settings import Settings

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; connect-src data: blob:; font-src data:; worker-src blob:; "
    "base-uri 'none'; form-action 'none'"
)
"""No address may be loaded from or sent to. Scripts are the page's own; the player's compiles WebAssembly."""


def report_html(
    examined: Examination,
    source: Source,
    settings: Settings | None = None,
    *,
    command: str = "",
    with_playback: bool = True,
) -> str:
    """The report of an examined flight as one HTML file in UTF-8.

    source: the log that the flight was read from; settings: those that it was examined with; command: the command
    line, to be shown. Without the playback it is about 1.5 MB smaller and a second or two faster.
    Raises InputError when plotly is not installed.
    """
    charts = Charts()
    subject = subject_of(examined, source, settings or Settings(), charts)
    sections = [
        findings(subject),
        flown.errors(subject),
        drift.drift(subject),
        drift.budget(subject),
        sensors.calibration(subject),
        sensors.siblings(subject),
        shaking.spectra(subject),
        shaking.shaking(subject),
        flown.track(subject),
    ]
    player: str | None = None
    if with_playback:
        section, player = playback(subject)
        sections.append(section)
    sections += [facts.log_facts(subject), facts.again(subject, command)]
    scripts = [
        ("companion", "application/json", _inert(encode(subject.document))),
        ("figures", "application/json", _inert(charts.json())),
        ("plotly", "application/gzip", charts.library()),
    ]
    if player is not None:
        scripts.append(("player", "application/json", _inert(msgspec.json.encode(player).decode())))
    carried = "\n".join(f'<script type="{kind}" id="{name}">{content}</script>' for name, kind, content in scripts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="referrer" content="no-referrer">'
        f'<meta name="color-scheme" content="light dark"><title>{text(source.path.name)}: IMU and autopilot</title>'
        f"<style>{_own('page.css')}</style></head><body>{head(subject)}{_contents(sections)}<main>"
        f'{"".join(map(_section, sections))}</main><noscript><p class="warning">The charts need JavaScript; the tables '
        f"are complete.</p></noscript>{carried}<script>{_own('page.js')}</script></body></html>\n"
    )


def _section(section: Section) -> str:
    return f'<section id="{section.anchor}"><h2>{text(section.title)}</h2>{section.body}</section>'


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#{section.anchor}">{text(section.title)}</a>' for section in sections)
    return f"<nav>{links}</nav>"


def _inert(json: str) -> str:
    """JSON that cannot end the element that it stands in."""
    return json.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _own(name: str) -> str:
    """A file beside this module."""
    return (files("companion.report") / name).read_text(encoding="utf-8")
