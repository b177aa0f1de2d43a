"""The 3D replay inside the page: a document of its own in a frame, so that its scripts and ours keep apart."""

from __future__ import annotations

from companion.present import paragraph
from companion.report.html_page import Section
from companion.report.subject import Subject

_WORDS = (
    "The solid drone is the IMU alone, the see-through blue one the autopilot. Drag to turn, scroll to come "
    "nearer, press play below."
)


def playback(subject: Subject) -> tuple[Section, str | None]:
    """The section, and the replay as an HTML document; None when there is nothing to play."""
    title = "3D playback"
    player = subject.apart.player
    if player is None:
        return Section("playback", title, paragraph(f"Not made: {subject.apart.why_no_replay}")), None
    frame = (
        '<div id="playback-place"><button id="playback-start" type="button">Load the 3D playback</button></div>'
        '<p class="paper">The 3D playback is in the file that this was printed from: open it in a browser.</p>'
    )
    return Section("playback", title, paragraph(_WORDS, "screen") + frame), player
