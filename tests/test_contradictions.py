"""What `analyze` prints of a flight does not contradict itself: numbers and statements of its screens, side by side."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from benchmarks.accuracy.labels import load_labels, recordings
from companion.app.examination import examine
from companion.app.recording import read_recording
from companion.cli import main
from companion.estimation import HYPOTHESES
from companion.model import words
from tests.recordings import BUNDLED, ROOT, SHARED, alike, recording, shared
from tests.remembered import once

pytestmark = pytest.mark.slow

OWN = (
    "sitl/copter-demo-100hz.tlog", "sitl/copter-hover-100hz.tlog", "sitl/copter-mission-default-rates.tlog",
    "sitl/copter-biased-imu-100hz.tlog", "sitl/copter-gps-glitch-50hz.tlog", "sitl/copter-imu1-fail-100hz.tlog",
    "px4/px4_hover_250hz.tlog", "px4/px4_square_lownoise.tlog",
)  # fmt: skip
QUICK = (
    "invariance/attitude_1hz_demo_25-75s.tlog.xz", "invariance/slide_gyrbias_z_77_40.tlog.xz",
    "strangers/erlerobot__logs__PXFv2.0b+Rpi.BIN.xz", "strangers/erlerobot__logs__73.BIN.xz",
    "ap_witness/clean_cruise.tlog.xz", "ap_witness/gyro1_z_15mrad.tlog.xz",
    "px4_faults/q_gps_creep.tlog.xz", "px4_faults/q_accel_step.tlog.xz",
)  # fmt: skip
"""Of those beside the project: few, quick, or analysed by other tests as well."""

FEWEST = 3  # windows that are judged
MANY = 10  # windows of a horizon, of which one decides nothing
CONSISTENT = 70  # % of the windows, at least
READINGS = ("frozen", "stuck axis", "gyro clipping", "accelerometer clipping", "units wrong", "axes wrong")
EXPLAINED = tuple(words(kind.name) for kind in HYPOTHESES)
SIZE = re.compile(r"(\([-\d., ]+\)|-?[\d.]+) ± ([\d.]+)")


@dataclass(frozen=True)
class Screens:
    """The short and the full screen of a flight."""

    short: str
    full: str

    @property
    def headline(self) -> str:
        return self.full.splitlines()[0]

    @property
    def suspects(self) -> bool:
        return self.headline.startswith(("IMU SUSPECT", "AUTOPILOT SUSPECT"))

    @property
    def consistent(self) -> bool:
        return self.headline.startswith("CONSISTENT")

    @property
    def findings(self) -> list[tuple[str, str, str]]:
        """Sign, kind and evidence of each."""
        found = re.findall(r"^  ([✗!·]) [\d.\-]+ s: ([\w ]+)\. (.*)$", self.full, re.MULTILINE)
        return [(sign, kind, evidence) for sign, kind, evidence in found]

    @property
    def inside(self) -> dict[float, tuple[int, list[int]]]:
        """Horizon, s → windows that are judged, and how many % of them are inside the bound in each quantity."""
        _, _, table = self.full.partition("Windows inside the 95 % bound")
        rows = [line.split() for line in table.split("\n\n")[0].splitlines() if re.match(r" *[\d.]+ s ", line)]
        return {float(row[0]): (int(row[6]), [int(c[:-1]) for c in row[7:] if c != "-"]) for row in rows}


def shares_differ(screens: Screens) -> Iterator[str]:
    for share, count, horizon in re.findall(r"(\d+) % of (\d+) windows? of ([\d.]+) s inside", screens.headline):
        told = screens.inside[float(horizon)]
        if told[0] != int(count) or min(told[1]) != int(share):
            yield f"{share} % of {count} above, {told} in the table"


def noises_differ(screens: Screens) -> Iterator[str]:
    told = re.findall(r"noise of (\d+) (\S+) in flight", screens.full)
    shown = re.findall(r"^\S* +\w+ [\d.]+ (\S+) expected.* ([\d.]+) in flight$", screens.full, re.MULTILINE)
    for density, unit in told:
        if not any(unit == one and abs(float(value) - float(density)) <= 0.5 for one, value in shown):
            yield f"noise of {density} {unit} in a finding, {shown} above"


def suspicion_that_was_not_judged(screens: Screens) -> Iterator[str]:
    if screens.suspects and re.search(r"Not judged +which side", screens.short):
        yield "somebody is suspect, and which side is wrong was not judged"


def misled_without_suspect(screens: Screens) -> Iterator[str]:
    if not screens.suspects and "was misled by it" in screens.full:
        yield "the autopilot was misled, and nobody is suspect"
    if screens.consistent and "misled by it" in screens.full:
        yield "the autopilot would have been misled, and both are consistent"


def explained_after_all(screens: Screens) -> Iterator[str]:
    if "no single cause explains it" in screens.full:
        yield from (
            f"{evidence} does" for sign, kind, evidence in screens.findings if sign != "·" and kind in EXPLAINED
        )


def agrees_though_its_readings_are_none(screens: Screens) -> Iterator[str]:
    if any(sign == "✗" and kind in READINGS for sign, kind, _ in screens.findings):
        yield from re.findall(r".*agrees with all other sensors", screens.full)


def fits_what_is_not_there(screens: Screens) -> Iterator[str]:
    if "no GPS" in screens.short or "No GPS" in screens.short:
        yield from re.findall(r"fits GPS.*", screens.full)


def smaller_than_its_sigma(screens: Screens) -> Iterator[str]:
    for _, _, evidence in screens.findings:
        for value, sigma in SIZE.findall(evidence):
            if max(abs(float(part)) for part in value.strip("()").split(",")) < float(sigma):
                yield f"{value} ± {sigma}"


def consistent_at_one_horizon_alone(screens: Screens) -> Iterator[str]:
    for horizon, (count, shares) in screens.inside.items():
        if screens.consistent and count >= (FEWEST if horizon == 5.0 else MANY) and min(shares) < CONSISTENT:
            yield f"{min(shares)} % after {horizon:g} s"


def no_window_beside_windows(screens: Screens) -> Iterator[str]:
    if screens.inside and "no window could be used" in screens.short:
        yield "no window could be used, and the table has some"


PATTERNS: tuple[Callable[[Screens], Iterator[str]], ...] = (
    shares_differ,
    noises_differ,
    suspicion_that_was_not_judged,
    misled_without_suspect,
    explained_after_all,
    agrees_though_its_readings_are_none,
    fits_what_is_not_there,
    smaller_than_its_sigma,
    consistent_at_one_horizon_alone,
    no_window_beside_windows,
)


TABLE = """
Windows inside the 95 % bound
            the IMU as it is        known errors removed
 after       n  att.  vel.  pos.       n  att.  vel.  pos.
──────────────────────────────────────────────────────────
   1 s     101   99%    2%  100%      93   99%    1%  100%
   5 s      20  100%   96%  100%      18  100%   94%  100%
"""
CONTRADICTIONS: dict[Callable[[Screens], Iterator[str]], tuple[str, str]] = {
    shares_differ: (
        "",
        "CONSISTENT  agree (100 % of 18 windows of 5 s inside the 95 % bound, known errors removed)." + TABLE,
    ),
    noises_differ: (
        "",
        "CONSISTENT\n  · 1.0-9.0 s: gyro noise. noise of 206 mdps/√Hz in flight, 51 times the 4 of a part\n"
        "Noise:     gyro 4.00 mdps/√Hz expected, 140 in flight",
    ),
    suspicion_that_was_not_judged: ("Not judged which side is wrong: no best estimate", "AUTOPILOT SUSPECT  it jumps"),
    misled_without_suspect: (
        "",
        "CONSISTENT\n  ! 1.0-9.0 s: gyro bias. 3 ± 1 mrad/s; the autopilot was misled by it: 8.8° in tilt",
    ),
    explained_after_all: (
        "",
        "CANNOT TELL  no single cause explains it.\n  ! 1.0-9.0 s: accelerometer scale. 3.2 ± 0.4 %",
    ),
    agrees_though_its_readings_are_none: (
        "",
        "IMU SUSPECT\n  ✗ 1.0-9.0 s: stuck axis. x\n  ! 1.0-9.0 s: IMUs disagree. it agrees with all other sensors",
    ),
    fits_what_is_not_there: (
        "Not judged velocity and position: no GPS",
        "IMU SUSPECT  it fits GPS, compass and gravity",
    ),
    smaller_than_its_sigma: ("", "CONSISTENT\n  · 1.0-9.0 s: compass field. the compass's field turns by 1 ± 2°"),
    consistent_at_one_horizon_alone: ("", "CONSISTENT" + TABLE),
    no_window_beside_windows: ("After 10 s no window could be used", "CONSISTENT" + TABLE),
}


@pytest.mark.parametrize("pattern", PATTERNS)
def test_each_pattern_knows_its_contradiction(pattern: Callable[[Screens], Iterator[str]]) -> None:
    assert list(pattern(Screens(*CONTRADICTIONS[pattern])))


def others() -> list[Any]:
    """Every recording beside the project that labels speak of, or whose verdict may not depend on how it is cut."""
    files = [ROOT / "benchmarks" / "accuracy" / "labels.toml", *SHARED.glob("labels_*.toml")]
    labels = [label for file in files for label in load_labels(file)]
    names = [path.relative_to(SHARED).as_posix() for path in recordings(SHARED)]
    told = [n for n in names if n.startswith("invariance/") or any(label.matches(n) for label in labels)]
    return [*QUICK, *alike(*(name for name in told if name not in QUICK and name not in OWN))]


def screens_of(path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Screens | None:
    """None of a recording that cannot be examined. Read and examined once, for both screens."""
    monkeypatch.setattr("companion.cli.options.read_recording", once(read_recording))
    monkeypatch.setattr("companion.app.examination.examine", once(examine))
    if main(["analyze", str(path)]) != 0:
        return None
    short = " ".join(capsys.readouterr().out.split())
    assert main(["analyze", str(path), "--full"]) == 0
    return Screens(short, capsys.readouterr().out)


@pytest.mark.parametrize("name", OWN)
def test_no_screen_contradicts_itself(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    screens = screens_of(recording(name), capsys, monkeypatch)
    assert screens is not None
    assert [f"{pattern.__name__}: {what}" for pattern in PATTERNS for what in pattern(screens)] == []


@pytest.mark.parametrize("name", others())
def test_no_screen_of_others_contradicts_itself(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    screens = screens_of(shared(name), capsys, monkeypatch)
    if screens is not None:
        assert [f"{pattern.__name__}: {what}" for pattern in PATTERNS for what in pattern(screens)] == []


@pytest.mark.parametrize("horizons", ["5", "2,30"])
def test_the_horizon_that_is_told_is_one_that_was_asked_for(horizons: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["analyze", str(BUNDLED / "copter-demo-100hz.tlog"), "--horizons", horizons]) == 0
    told = re.findall(r"^After ([\d.]+) s +the IMU alone is off by", capsys.readouterr().out, re.MULTILINE)
    assert told == [horizons.partition(",")[0]]
