"""What the page asks for, answered from one flight and the settings: the reckoning at once, the analysis after it."""

from __future__ import annotations

import shlex
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from companion.analysis import (
    NO_CORRECTION,
    Assessment,
    Correction,
    ImuNoise,
    Integration,
    Replay,
    errors,
    expected_since_anchor,
    imu_noise,
    replay,
    replay_from_rest,
    trailing,
)
from companion.app.correction import load_correction
from companion.app.examination import Examination, align_imu, assess_imu, examine
from companion.app.recording import Source
from companion.app.settings import Settings
from companion.model import DataError, Flight

if TYPE_CHECKING:  # viser is slow to import, and only `view` needs it
    from companion.view import Footage, Insight, Reckoning, ReplayChoice


_SAME_S = 0.01  # the page rounds the start that it shows


class Answers:
    """Called from several worker threads at once."""

    def __init__(
        self,
        settings: Settings,
        *,
        imu_model: str | None = None,
        correction: str | Path | None = None,
        from_rest: bool = False,
    ):
        self._settings, self._imu_model, self._from_rest = settings, imu_model, from_rest
        self._file = load_correction(correction) if correction is not None else None
        self._lock = threading.Lock()
        self._found: dict[tuple[int, str, Integration], Correction | None] = {}
        self._last: tuple[tuple[object, ...], Examination] | None = None

    def recompute(self, flight: Flight, choice: ReplayChoice) -> Reckoning:
        """The replay of the chosen IMU, corrected as chosen, and of the others as they are."""
        from companion.view import Reckoning, chosen_track, with_track  # noqa: PLC0415

        how = choice.integration(flight)
        track = chosen_track(flight, choice, self._correction(flight, choice, how))
        seen = with_track(flight, track)
        others = {name: self._replay(flight, name, choice, how) for name in choice.others}
        return Reckoning(self._replay(seen, choice.imu, choice, how), track, others)

    def examine(self, flight: Flight, choice: ReplayChoice, film: Footage) -> Insight:
        """What the analysis says of what was reckoned: the same numbers as `companion analyze`."""
        from companion.view import Insight  # noqa: PLC0415

        examined = self._examination(flight, choice, film)
        assessment = examined.assessment
        comparison = assessment.comparison
        return Insight(
            assessment,
            trailing=errors(comparison, trailing(comparison, choice.horizon_s)),
            horizon_s=choice.horizon_s,
            siblings=examined.siblings,
            expected=expected_since_anchor(assessment, film.replay),
            noise=_noise_of(flight, assessment),
        )

    def _replay(self, flight: Flight, imu: str | None, choice: ReplayChoice, how: Integration) -> Replay:
        """From rest where that was asked for, as long as the page asks for no anchor of the autopilot's."""
        if self._from_rest and choice.reanchor_s is None:
            aligned = align_imu(flight, self._settings, imu=imu, imu_model=self._imu_model, how=how)
            if choice.start_s is None or abs(choice.start_s - aligned.rest.start_s) < _SAME_S:
                return replay_from_rest(flight, aligned, imu=imu, how=how)
        return replay(flight, imu=imu, how=how, reanchor_s=choice.reanchor_s, start_s=choice.start_s)

    def report(self, source: Source, flight: Flight, choice: ReplayChoice, film: Footage) -> str:
        """The report of what is shown, without the playback: the page has that."""
        from companion.report import report_html  # noqa: PLC0415  (plotly is slow to import)

        examined = self._examination(flight, choice, film)
        command = shlex.join(["companion", *sys.argv[1:]])
        return report_html(examined, source, self._settings, command=command, with_playback=False)

    def _examination(self, flight: Flight, choice: ReplayChoice, film: Footage) -> Examination:
        """Everything about what was reckoned; found once, for the horizon and the anchors change nothing in it."""
        from companion.view import with_track  # noqa: PLC0415

        how = choice.integration(flight)
        key = (id(flight), choice.imu, how, choice.correction, choice.gyro_bias, choice.accel_bias)
        last = self._last
        if last is not None and last[0] == key:
            return last[1]
        seen = with_track(flight, film.track) if film.track else flight
        self._last = None  # room for the next: an hour's analysis is large
        examined = examine(seen, self._settings, imu=choice.imu, imu_model=self._imu_model, how=how)
        self._last = key, examined
        if not choice.corrects:
            with self._lock:
                self._found[id(flight), film.source, how] = _correction_of(examined.assessment)
        return examined

    def _correction(self, flight: Flight, choice: ReplayChoice, how: Integration) -> Correction:
        """What is taken off the chosen IMU. Raises DataError when this flight tells nothing to take off."""
        if choice.correction == "no":
            return NO_CORRECTION
        if choice.correction == "file":
            return self._file or NO_CORRECTION
        name = flight.imu(choice.imu).source
        with self._lock:  # whoever comes first finds it out
            key = (id(flight), name, how)
            if key not in self._found:
                found = assess_imu(flight, self._settings, imu=name, imu_model=self._imu_model, how=how)
                self._found[key] = _correction_of(found)
            correction = self._found[key]
        if correction is None:
            raise DataError("This flight has too few usable windows to calibrate with. Record a longer one.")
        return correction


def _noise_of(flight: Flight, found: Assessment) -> ImuNoise | None:
    comparison = found.comparison
    try:
        return imu_noise(flight, comparison.track.source, found.figures, comparison.how.limits)
    except DataError:
        return None


def _correction_of(found: Assessment) -> Correction | None:
    return found.calibration.correction if found.calibration else None
