"""What of a report does not rest on the verdict, and may be made while that is found."""

from __future__ import annotations

from dataclasses import dataclass, replace

from companion.analysis import (
    Comparison,
    Expectation,
    ImuNoise,
    ImuSpec,
    ReferenceSpec,
    Replay,
    expected_since_anchor,
    imu_noise,
    replay,
)
from companion.app.settings import Settings
from companion.model import CompanionError, DataError, Flight


@dataclass(frozen=True, slots=True, eq=False)
class Apart:
    """Of one IMU of a flight."""

    replay: Replay | None
    why_no_replay: str
    expected: Expectation | None  # of the replay's errors; None without a replay, or where nothing can be expected
    noise: ImuNoise | str  # or why it is not told
    player: str | None  # the 3D replay as an HTML document; None when there is nothing to play, or it is not wanted


def made_apart(
    flight: Flight,
    comparison: Comparison,
    figures: ImuSpec,
    autopilot: ReferenceSpec,
    settings: Settings,
    *,
    with_playback: bool,
) -> Apart:
    """figures, autopilot: how far off the IMU and the autopilot may be."""
    shown, why = _replay_of(flight, comparison, settings)
    expected = None if shown is None else expected_since_anchor(comparison, figures, autopilot, shown)
    try:
        noise: ImuNoise | str = imu_noise(flight, comparison.track.source, figures, comparison.how.limits)
    except DataError as error:
        noise = str(error)
    if not with_playback or shown is None:
        return Apart(shown, why, expected, noise, None)
    from companion.view import display_trajectory, replay_page  # noqa: PLC0415  (brings viser, which is slow to import)

    return Apart(shown, why, expected, noise, replay_page(display_trajectory(shown, comparison.track), flight))


def _replay_of(flight: Flight, comparison: Comparison, settings: Settings) -> tuple[Replay | None, str]:
    """The replay of the IMU that is compared; where there is none, why."""
    track = comparison.track
    try:
        shown = replay(
            replace(flight, imus={**flight.imus, track.source: track}),
            imu=track.source,
            how=comparison.how,
            reanchor_s=settings.view.reanchor_s or None,
            reference=comparison.reference,
        )
    except CompanionError as error:
        return None, str(error)
    return shown, ""
