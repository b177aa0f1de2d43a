"""What the live page says is text, whatever a vehicle, a file name or an error message holds."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from companion.present import palette
from companion.verdict import Cause, LiveVerdict, State
from companion.view import LinkState, ReplayChoice, StreamState
from companion.view.panels import live_panel, markup
from tests.view.browser_messages import Tags
from tests.view.circles import make_flight, recompute

EVIL = "<img src=x onerror=\"document.title='owned'\"><script>alert(1)</script>"


def test_nothing_that_comes_from_outside_becomes_markup() -> None:
    state = LinkState(
        link=EVIL, problem=EVIL, streams=(StreamState(EVIL, 100.0, 99.0, EVIL),), frames=10, lost={EVIL: 0.1},
        rejected=3, latency_ms=2.0, clock=EVIL, recording=EVIL, recorded_bytes=5, recording_problem="",
    )  # fmt: skip
    for shown in (
        live_panel.link(state, EVIL, None),
        live_panel.verdict(LiveVerdict(cast("State", EVIL), EVIL), LinkState("a"), EVIL),
        live_panel.verdict(LiveVerdict("", EVIL), state, EVIL),
        live_panel.legend(EVIL, has_position=True),
        live_panel.health(state),
        live_panel.drift((), LiveVerdict(cast("State", EVIL), EVIL), [LiveVerdict("lost", EVIL, vehicle=EVIL)]),
        live_panel.messages([EVIL]),
    ):
        tags = Tags(shown)
        assert tags.tags <= {"div", "span", "small", "b", "table", "tr", "th", "td", "style"}
        assert "<img src=x" in tags.words


def test_the_verdict_now_is_the_banner_or_why_there_is_none() -> None:
    def text(now: LiveVerdict, problem: str = "", why_not: str = "") -> str:
        return Tags(live_panel.verdict(now, LinkState("udpin:1", problem), why_not)).words

    suspect = LiveVerdict("imu_suspect", "Suspect the IMU: stuck.", newest=1.0, age_s=2.0)
    assert text(suspect).endswith("✗ IMU suspectStuck.")
    assert text(replace(suspect, age_s=7.0)).endswith("IMU suspect as of 7\xa0s agoStuck.")
    cause = Cause("gyro_bias", "imu", 45.1, sensor="gyro", axis="z")
    assert text(replace(suspect, cause=cause)).endswith("✗ Gyro z wrong, since 45\xa0sStuck.")
    assert text(replace(suspect, cause=replace(cause, end_s=60.0))).endswith("✗ Gyro z wrong, 45-60\xa0sStuck.")
    alarm, agreed = palette.css(markup.COLOURS["imu_suspect"]), palette.css(markup.COLOURS["consistent"])
    old = replace(suspect, age_s=7.0)
    for link in (LinkState("udpin:1"), LinkState("udpin:1", "silent for 7 s")):
        shown = live_panel.verdict(replace(old, silent=bool(link.problem)), link, "")
        assert alarm in shown, "nothing has taken it back"
        assert ("link silent for" in shown) == bool(link.problem)
    well = replace(old, status="consistent", text="IMU and autopilot agree.")
    assert agreed in live_panel.verdict(replace(well, age_s=1.0), LinkState("udpin:1"), "")
    assert agreed not in live_panel.verdict(well, LinkState("udpin:1"), ""), "and this is dimmed"
    assert text(LiveVerdict("", ""), problem="silent for 7 s").endswith("No verdict: silent for 7\xa0s")
    assert text(LiveVerdict("", ""), why_not="no IMU messages").endswith("no IMU messages")
    assert "No verdict yet" in text(LiveVerdict("", ""))
    assert "Starting" in text(LiveVerdict("starting", "The estimator aligns."))


def test_the_link_says_how_it_stands() -> None:
    def text(state: LinkState, why_not: str = "", held_s: float | None = None) -> str:
        return Tags(live_panel.link(state, why_not, held_s)).words

    good = LinkState("udpin:1", frames=5, recording="a.tlog", recorded_bytes=2_500_000)
    assert text(good) == "LIVE● Recording a.tlog, 2.5 MB"
    assert text(good, held_s=3.21) == "PAUSED, 3.2 s ago● Recording a.tlog, 2.5 MB"
    assert text(good, "no IMU messages").startswith("WAITINGno IMU messages")
    assert text(LinkState("udpin:1", "silent for 7 s", frames=5)) == "RECONNECTINGsilent for 7 sNot recorded"
    assert text(LinkState("udpin:1", "nothing received yet")).startswith("WAITINGnothing received yet")
    full = LinkState("udpin:1", frames=5, recording="a.tlog", recording_problem="the disk is full")
    assert text(full) == "LIVEthe disk is full"


def test_the_numbers_of_a_silent_link_are_those_of_the_last_sample() -> None:
    display = recompute(make_flight(), ReplayChoice())
    last = display.at(display.end)
    now, silent = (live_panel.numbers(last, None, has_position=True, silent=silent) for silent in (False, True))
    assert "when last received" not in now
    assert "Error when last received" in silent
    assert ("canvas" in silent, "canvas" in now) == (True, False)  # the picture and the charts are dimmed too
    tilt = f'opacity:{palette.QUIET}"><td>tilt</td><td>{last.tilt_deg:.2f}°'
    assert (tilt in silent, tilt in now) == (True, False)


def test_losses_latency_and_what_is_dropped() -> None:
    state = LinkState("udpin:1", frames=90, lost={"1:1": 0.1}, rejected=4, latency_ms=7.25, clock="Booted at 10:00:00")
    text = Tags(live_panel.health(state)).words
    assert "90 frames, 10.00 % of 1:1 lost" in text
    assert "Latency 7.2 ms" in text
    assert "4 frames dropped: not signed, or not with our key" in text
