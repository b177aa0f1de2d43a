"""Times in flight without a valid position, or without a GPS fix."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import companion as c
from companion.comparison import GENERIC
from companion.comparison.windows import compare
from companion.model import Flight, Phase, SensorInUse, Series
from companion.verdict import Finding, assess
from companion.verdict.findings.outages import interference_findings, outage_findings, poor_gps_findings
from tests.flights import CIRCLE, flown
from tests.recordings import recording

BEGIN, END = CIRCLE.t[0], CIRCLE.t[-1]


def without(flight: Flight, *, position: tuple[float, float] = (0, 0), fixes: tuple[float, float] = (0, 0)) -> Flight:
    """The flight without its position and without fixes in two stretches of time, s."""
    track, gps = flight.position, flight.gps[0]
    assert track is not None
    kept = (track.t < position[0]) | (track.t > position[1])
    lost = (gps.t >= fixes[0]) & (gps.t <= fixes[1])
    return replace(
        flight,
        position=replace(track, t=track.t[kept], position=track.position[kept], velocity=track.velocity[kept]),
        gps=(replace(gps, fix_type=np.where(lost, 1.0, gps.fix_type)),),
    )


def outages(flight: Flight) -> list[Finding]:
    compared = compare(flight)
    return list(outage_findings(flight, compared.track.t, compared.gaps))


def lines(flight: Flight) -> list[tuple[str, float, float]]:
    return [(f.kind, round(f.start_s, 1), round(f.end_s, 1)) for f in outages(flight)]


def test_a_flight_with_position_and_fixes_has_no_outage() -> None:
    assert lines(flown(CIRCLE)) == []
    assert lines(without(flown(CIRCLE), position=(30.0, 34.0), fixes=(40.0, 44.0))) == []


def test_a_position_that_is_lost_is_told_once_with_the_fixes_that_it_lacked() -> None:
    flight = without(flown(CIRCLE), position=(30.0, 37.0), fixes=(25.0, 39.0))
    (said,) = outages(flight)
    assert said.kind == "position_lost"
    assert (said.start_s, said.end_s) == pytest.approx((30.0, 37.0), abs=0.2)
    assert "no GPS fix from 24." in said.evidence


def test_a_position_that_is_lost_before_a_flight_begins_has_moved_since_it_was_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, flies = without(flown(CIRCLE), position=(30.0, 42.0)), Phase(33.0, END, "flight", "after an impact")
    moved = [f.evidence.partition("in which")[2] for f in outages(whole)]
    monkeypatch.setattr("companion.verdict.findings.outages.in_the_air", lambda _: [flies])
    (said,) = outages(whole)
    assert "no position for 9" in said.evidence
    assert [said.evidence.partition("in which")[2]] == moved


def test_a_position_that_is_lost_to_the_end_is_told_too() -> None:
    ((kind, begin, end),) = lines(without(flown(CIRCLE), position=(50.0, np.inf)))
    assert kind == "position_lost"
    assert (begin, end) == pytest.approx((50.0, END), abs=0.2)


def test_a_position_without_fixes_is_dead_reckoned() -> None:
    ((kind, begin, end),) = lines(without(flown(CIRCLE), fixes=(30.0, 45.0)))
    assert kind == "dead_reckoned"
    assert (begin, end) == pytest.approx((30.0, 45.0), abs=0.5)


@pytest.mark.parametrize("what", [{"position": (30.0, np.inf)}, {"fixes": (30.0, np.inf)}], ids=["position", "fixes"])
def test_what_goes_on_is_headed_by_its_beginning_not_by_how_long_it_has_lasted(what: Any) -> None:
    (lasts,) = outages(without(flown(CIRCLE), **what))
    assert "since 30." in lasts.headline or "since 29." in lasts.headline
    (over,) = outages(without(flown(CIRCLE), **dict.fromkeys(what, (30.0, 45.0))))
    assert not over.headline


def test_what_never_was_there_is_not_lost() -> None:
    flight = flown(CIRCLE)
    assert lines(replace(flight, position=None)) == []
    assert lines(replace(flight, gps=())) == []


@pytest.mark.parametrize(
    ("state", "indicator", "spoofing", "said"),
    [(1, 200, 1, []), (2, 0, 0, ["jammed"]), (0, 90, 0, ["jammed"]), (0, 52, 1, []), (1, 0, 3, ["spoofed"])],
)
def test_a_receiver_that_says_that_it_is_disturbed(state: int, indicator: int, spoofing: int, said: list[str]) -> None:
    flight = flown(CIRCLE)
    t = np.arange(BEGIN, END, 0.2)
    values = np.where(((t > 30.0) & (t < 40.0))[:, None], [float(state), float(indicator), float(spoofing)], 0.0)
    columns = ("jamming_state", "jamming_indicator", "spoofing_state")
    told = replace(flight, series={"interference": Series(t, values, columns, "sensor_gps")})
    found = list(interference_findings(told))
    assert [f.evidence.partition("it is ")[2].partition(",")[0] for f in found] == said
    assert all((f.start_s, f.end_s) == pytest.approx((30.0, 40.0), abs=0.3) for f in found)


@pytest.mark.parametrize(
    ("source", "bit"), [("EKF_STATUS_REPORT", 15), ("ESTIMATOR_STATUS", 10), ("estimator_status", 10), ("XKF4[0]", 14)]
)
@pytest.mark.parametrize("rate_hz", [1.0, 5.0])
def test_an_estimator_that_doubts_its_gps_may_dead_reckon(source: str, bit: int, rate_hz: float) -> None:
    t = np.arange(BEGIN, END, 1.0 / rate_hz)
    for end, said in ((34.0, []), (42.0, ["dead_reckoned"])):
        flags = np.where((t >= 30.0) & (t <= end), 0b11111 | 1 << bit, 0b11111).astype(float)
        told = replace(flown(CIRCLE), series={"estimator": Series(t, flags[:, None], ("flags",), source)})
        assert [kind for kind, *_ in lines(told)] == said
    assert lines(told)[0][1:] == pytest.approx((30.0, 42.0), abs=0.2)
    (finding,) = outages(told)
    assert "the estimator doubts its GPS for 1" in finding.evidence
    assert finding.evidence.endswith("it may dead-reckon"), "EKF3 may be using it all the while"


@pytest.mark.parametrize("flew", [0, 1])
@pytest.mark.parametrize("rejects", [0, 1])
def test_an_estimator_that_did_not_fly_may_reject_its_gps(flew: int, rejects: int) -> None:
    t = np.arange(BEGIN, END, 0.2)
    rejected = np.where((t >= 30.0) & (t <= 42.0), 0b11111 | 1 << 10, 0b11111)
    series = {
        f"estimator{':' * number}{source if number else ''}": Series(
            t, np.where(number == rejects, rejected, 0b11111)[:, None].astype(float), ("flags",), source, number
        )
        for number, source in enumerate(("estimator_status", "estimator_status_1"))
    }
    used = SensorInUse(np.array([BEGIN]), np.array([flew]), "estimator_selector_status")
    told = replace(flown(CIRCLE), series=series, lane_in_use=used)
    assert [kind for kind, *_ in lines(told)] == ["dead_reckoned"] * (flew == rejects)


@pytest.mark.parametrize(("flags", "says"), [(0b00111, True), (0b11111, False), (np.nan, False)])
def test_a_position_that_never_was_valid_is_said_and_accuses_nobody(flags: float, *, says: bool) -> None:
    t = np.arange(BEGIN, END, 0.2)
    series = {"estimator": Series(t, np.full((len(t), 1), flags), ("flags",), "ESTIMATOR_STATUS")}
    said = outages(flown(CIRCLE, position=None, series=series))
    assert [(f.side, f.severity, f.undecided) for f in said] == [("data", "info", False)] * says


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"satellites": 4.0}, ["4 satellites"]),
        ({"horizontal_sigma": 12.0}, ["14 satellites", "±12.0 m"]),
        ({"speed_sigma": 2.0}, ["±2.0 m/s"]),
        ({"satellites": 7.0}, []),
        ({"fix_type": 1.0}, []),
    ],
)
def test_a_receiver_that_calls_its_fix_poor(changes: dict[str, float], said: list[str]) -> None:
    flight = flown(CIRCLE)
    (gps,) = flight.gps
    poor = (gps.t > 30.0) & (gps.t < 40.0)
    worse: dict[str, Any] = {name: np.where(poor, value, getattr(gps, name)) for name, value in changes.items()}
    found = list(poor_gps_findings(replace(flight, gps=(replace(gps, **worse),))))
    assert len(found) == bool(said)
    assert all(words in found[0].evidence for words in said)


def test_a_fix_that_comes_and_goes_is_called_none_at_worst() -> None:
    """Also where the receiver tells neither satellites nor accuracies."""
    flight = flown(CIRCLE)
    (gps,) = flight.gps
    lost = (gps.t > 30.0) & (gps.t < 40.0) & (np.arange(len(gps)) % 2 > 0)
    unknown: dict[str, Any] = dict.fromkeys(
        ("satellites", "horizontal_sigma", "vertical_sigma", "speed_sigma"), np.full(len(gps), np.nan)
    )
    comes_and_goes = replace(gps, fix_type=np.where(lost, 1.0, gps.fix_type), **unknown)
    (said,) = poor_gps_findings(replace(flight, gps=(comes_and_goes,)))
    assert said.evidence.endswith("at worst no 3D fix")


def test_a_receiver_that_never_has_a_fix_is_said() -> None:
    t = np.arange(BEGIN, END, 0.2)
    none = Series(
        t, np.column_stack([np.full(len(t), np.nan), np.arange(len(t)) % 4.0]), ("lat_rad", "satellites"), "GPS"
    )
    (said,) = poor_gps_findings(replace(flown(CIRCLE), gps=(), series={"gps": none}))
    assert said.severity == "info"
    assert "never has a fix: 3 satellites" in said.evidence


@pytest.mark.slow
def test_who_lost_its_position_is_neither_accused_nor_called_consistent() -> None:
    found = assess(without(flown(CIRCLE), position=(30.0, 37.0)), GENERIC)
    assert found.verdict.status == "insufficient_data"
    assert "no position for 7" in found.verdict.summary


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "begin"),
    [("ap_turn3/f_gpsloss.tlog", "position_lost", 111.7), ("px4_turn3/gps_loss60.ulg", "position_lost", 49.0)],
)
def test_recorded_outages(name: str, kind: str, begin: float) -> None:
    flight = c.open_log(recording(name))[0]
    found = {f.kind: f for f in c.examine(flight).assessment.verdict.findings}
    assert found[kind].start_s == pytest.approx(begin, abs=0.5)


@pytest.mark.slow
def test_an_autopilot_that_says_that_it_has_no_position_is_not_accused_of_one() -> None:
    flight = c.open_log(recording("px4_turn3/h_nogps.tlog"))[0]
    assert flight.position is None
    assert c.examine(flight).assessment.verdict.status in ("consistent", "insufficient_data")
