"""The page of a replayed flight, and the answers to its requests: dead reckoning at once, the analysis after it.

The one way to that page, for the command line and for a notebook. It loads viser, which takes a second.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from companion.app.correction import load_correction
from companion.app.examination import Examination, align_imu, assess_imu, examine, integration_of, redundant_lanes
from companion.app.recording import Source
from companion.app.sensors import preflight_of
from companion.app.settings import Settings
from companion.comparison import (
    NO_CORRECTION,
    Correction,
    Expected,
    ImuNoise,
    Integration,
    Replay,
    expected_over,
    imu_noise,
    replay,
    replay_from_rest,
)
from companion.model import DataError, Flight
from companion.verdict import Assessment, Verdict
from companion.view import (
    AnalysisResult,
    DisplayTrajectory,
    FlightChecks,
    Offer,
    ReplayChoice,
    Viewer,
    analysed,
    chosen_track,
    display_trajectory,
    first_horizon,
)

_SAME_S = 0.01  # the page rounds the start that it shows
_Key = tuple[object, ...]
"""What an examination depends on: flight, IMU, integration and correction, and neither the horizon nor the anchors."""


class Answers:
    """Called from several worker threads at once.

    imu_model, correction: as `examine` takes them; from_rest: dead-reckon from where the IMU can be aligned by itself;
    command: the command line in a report. Raises InputError and SettingsError for a correction that cannot be read.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        imu_model: str | None = None,
        correction: str | Path | None = None,
        from_rest: bool = False,
        command: str = "",
    ):
        self.settings, self.from_rest = settings, from_rest
        self.correction_file = Path(correction).name if correction is not None else None
        self._imu_model, self._command = imu_model, command
        self._file = load_correction(correction) if correction is not None else None
        self._lock = threading.Lock()
        self._corrections: dict[_Key, Correction | None] = {}  # of an IMU as it is
        self._last: tuple[_Key, Examination] | None = None

    def recompute(self, flight: Flight, choice: ReplayChoice) -> DisplayTrajectory:
        """The replay of the chosen IMU, corrected as chosen, and of the others as they are."""
        how = choice.integration(flight)
        track = chosen_track(flight, choice, self._correction(flight, choice, how))
        seen = flight.with_imu(track)
        others = {name: self._replay(flight, name, choice, how) for name in choice.others}
        return display_trajectory(self._replay(seen, choice.imu, choice, how), track, others)

    def judge(self, flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> Verdict:
        """The verdict on what is shown; the rest of its analysis is made by `examine`, which goes on from it."""
        return self._examination(flight, choice, display).assessment.verdict

    def examine(self, flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> AnalysisResult:
        """The analysis of what is shown: the same numbers as `companion analyze`."""
        examined = self._examination(flight, choice, display)
        assessment = examined.assessment
        result = replace(
            analysed(flight, display, assessment, choice.horizon_s, choice.reanchor_s),
            redundant_imus=examined.redundant_imus,
            noise=_noise_of(flight, assessment),
            calibrated=_calibrated(assessment, choice.horizon_s),
        )
        if not choice.corrects:
            with self._lock:  # what is kept when the analysis makes room for the next
                self._corrections[_key(flight, choice)] = _correction_of(assessment)
        return result

    def check(self, flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> FlightChecks:
        """What `companion lanes` and `companion preflight` print, where the log has it."""
        own = self._examination(flight, choice, display).assessment
        judged = redundant_lanes(flight, self.settings, own)
        try:
            before = preflight_of(flight)
        except DataError:  # it never stands
            before = None
        return FlightChecks(None if judged is None else judged[0], before)

    def _replay(self, flight: Flight, imu: str | None, choice: ReplayChoice, how: Integration) -> Replay:
        """From rest where requested, as long as the page requests no anchor of the autopilot's."""
        if self.from_rest and choice.reanchor_s is None:
            aligned = align_imu(flight, self.settings, imu=imu, imu_model=self._imu_model, how=how)
            if choice.start_s is None or abs(choice.start_s - aligned.rest.start_s) < _SAME_S:
                return replay_from_rest(flight, aligned, imu=imu, how=how)
        return replay(flight, imu=imu, how=how, reanchor_s=choice.reanchor_s, start_s=choice.start_s)

    def report(self, source: Source, flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> str:
        """The report of what is shown, without the playback: the page has that."""
        from companion.report import report_html  # noqa: PLC0415  (rarely requested)

        examined = self._examination(flight, choice, display)
        return report_html(examined, source, self.settings, command=self._command, with_playback=False)

    def know(self, examined: Examination, choice: ReplayChoice) -> None:
        """Take what was examined as chosen, by somebody else, for the answer."""
        self._last = _key(examined.flight, choice), examined

    def _examination(self, flight: Flight, choice: ReplayChoice, display: DisplayTrajectory) -> Examination:
        """Everything about what is shown; made once, for the horizon and the anchors change nothing in it."""
        last, key, how = self._last, _key(flight, choice), choice.integration(flight)
        if last is not None and last[0] == key:
            return last[1]
        seen = flight.with_imu(display.track) if display.track else flight
        self._last = None  # room for the next: an hour's analysis is large
        examined = examine(seen, self.settings, imu=choice.imu, imu_model=self._imu_model, how=how)
        if choice.corrects:  # a correction is of one IMU: the others stand beside it as it is
            examined = replace(examined, flight=flight, correction=self._correction_words(choice))
        self._last = key, examined
        return examined

    def _correction_words(self, choice: ReplayChoice) -> str:
        """What is taken off the readings: the name of the file, and whatever else."""
        known = {"no": "", "flight": "the calibration of this flight", "file": self.correction_file or ""}
        parts = [known[choice.correction]]
        for bias, factor, what, unit in (
            (choice.gyro_bias, 1e3, "gyro", "mrad/s"),
            (choice.accel_bias, 1.0, "accelerometer", "m/s²"),
        ):
            if any(bias):
                parts.append(f"{what} bias {', '.join(f'{factor * axis:g}' for axis in bias)} {unit}")
        return "; ".join(filter(None, parts))

    def _correction(self, flight: Flight, choice: ReplayChoice, how: Integration) -> Correction:
        """The correction of the chosen IMU. Raises DataError when this flight cannot be calibrated."""
        if choice.correction == "no":
            return NO_CORRECTION
        if choice.correction == "file":
            return self._file or NO_CORRECTION
        key = _key(flight, ReplayChoice(choice.imu, how=choice.how, gravity=choice.gravity))  # as it is
        with self._lock:  # whoever comes first finds it out
            if key not in self._corrections:
                last = self._last
                self._corrections[key] = _correction_of(
                    last[1].assessment
                    if last is not None and last[0] == key
                    else assess_imu(flight, self.settings, imu=choice.imu, imu_model=self._imu_model, how=how)
                )
            correction = self._corrections[key]
        if correction is None:
            raise DataError("This flight has too few usable windows to calibrate with. Record a longer one.")
        return correction


def open_replay(
    answers: Answers,
    flights: Sequence[Flight],
    *,
    chosen: int = 0,
    imu: str | None = None,
    source: Source | None = None,
    examined: Examination | None = None,
    map_shown: bool = False,
    port: int,
    or_next: bool = True,
) -> Viewer:
    """Serve the page of these flights, and return when it can be opened.

    chosen: index of the flight shown first; imu: the message integrated; source: the log, without which the page offers
    no report; examined: what is known of the chosen flight already, of the IMU that it tells; port, or_next: see
    `Viewer`. Raises DataError when the flight cannot be integrated, InputError for an address that is none.
    """
    settings, flight = answers.settings, flights[chosen]
    horizons = settings.drift.horizons_s
    choice = ReplayChoice(
        imu=imu,
        how=integration_of(settings, flight),
        gravity=settings.integration.gravity,
        reanchor_s=None if answers.from_rest else settings.view.reanchor_s or None,
        horizon_s=first_horizon(horizons),
        correction="no" if answers.correction_file is None else "file",
    )
    if examined is not None:
        choice = _as_examined(examined, choice)
        if not choice.corrects:  # a file's correction is known as applied, and the page applies it itself
            answers.know(examined, choice)
    return Viewer(
        flights,
        answers.recompute,
        answers.examine,
        flight=chosen,
        choice=choice,
        offer=Offer(
            horizons,
            answers.correction_file,
            answers.judge,
            answers.check,
            partial(answers.report, source) if source is not None else None,
            settings.view.map_url,
            map_shown,
        ),
        host=settings.view.host,
        port=port,
        or_next=or_next,
        token=settings.view.token,
    )


def _as_examined(examined: Examination, choice: ReplayChoice) -> ReplayChoice:
    """The IMU that was examined, integrated as it was then."""
    comparison = examined.assessment.comparison
    how = comparison.how
    gravity = choice.gravity if choice.integration(examined.flight).gravity == how.gravity else how.gravity
    return replace(choice, imu=comparison.track.source, how=how, gravity=gravity)


def _key(flight: Flight, choice: ReplayChoice) -> _Key:
    imu = flight.imu(choice.imu).source
    return id(flight), imu, choice.integration(flight), choice.correction, choice.gyro_bias, choice.accel_bias


def _noise_of(flight: Flight, assessment: Assessment) -> ImuNoise | None:
    comparison = assessment.comparison
    try:
        return imu_noise(flight, comparison.track.source, assessment.imu_spec, comparison.how.limits)
    except DataError:
        return None


def _calibrated(assessment: Assessment, horizon_s: float) -> Expected | None:
    """What windows may be off by once the biases that the flight tells are taken off; None where it tells none."""
    fit, imu_spec = assessment.calibration, assessment.imu_spec
    rows = [i for i, one in enumerate(assessment.drift.rows) if one.horizon_s == horizon_s]
    if fit is None or assessment.made_worse or not rows:
        return None
    gyro, accel = (float((fit.sigma[axes] ** 2).mean() ** 0.5) for axes in (slice(0, 3), slice(3, 6)))
    own = replace(
        imu_spec,
        gyro=replace(imu_spec.gyro, residual_bias=min(gyro, imu_spec.gyro.residual_bias)),
        accel=replace(imu_spec.accel, residual_bias=min(accel, imu_spec.accel.residual_bias)),
    )
    return expected_over(assessment.comparison, assessment.sets[rows[0]], own, assessment.autopilot)


def _correction_of(assessment: Assessment) -> Correction | None:
    return assessment.calibration.correction if assessment.calibration else None
