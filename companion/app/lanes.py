"""The lanes of a flight against its best estimate, carried by an IMU that is in order where there is one."""

from __future__ import annotations

from companion.analysis import Assessment, Lanes, judge_lanes, known_share
from companion.app.examination import assess_imu
from companion.app.resources import one_blas_thread
from companion.app.settings import Settings
from companion.estimation import BestEstimate
from companion.model import DataError, Flight, NoEstimateError


@one_blas_thread
def lanes_of(flight: Flight, settings: Settings, own: Assessment | None = None) -> tuple[Lanes, BestEstimate]:
    """Every lane judged, and the best estimate that they were judged by. own: of the flight, where it has been made.

    An estimate that has an error of its own IMU explained away is not known as well as that of an IMU that is in order.
    Raises NoEstimateError where no IMU carries an estimate, and DataError as `examine`.
    """
    first = own or assess_imu(flight, settings)
    used = flight.imu(first.comparison.track.source)
    by = first
    if first.best is None or _is_wrong(first):
        names = [one.source for one in flight.each_imu() if one.instance != used.instance]
        others = [one for name in names if (one := _assessed(flight, settings, name)) is not None]
        by = max([first, *others], key=lambda one: (not _is_wrong(one), one.best is not None and known_share(one.best)))
    if by.best is None:
        raise NoEstimateError(
            used.source, "; ".join(by.sensitivity.not_judged), "Look at the log with companion info, or try --imu."
        )
    return judge_lanes(flight, by.best, first.verdict.findings), by.best


def redundant_lanes(flight: Flight, settings: Settings, own: Assessment) -> tuple[Lanes, BestEstimate] | None:
    """The same of a flight that has two numbered lanes or more, and a best estimate of its own; None of any other."""
    if sum(lane.core is not None for lane in flight.lanes) < 2 or own.best is None:
        return None
    try:
        return lanes_of(flight, settings, own)
    except DataError:
        return None


def _is_wrong(one: Assessment) -> bool:
    """Whether the IMU that was assessed is at fault itself."""
    own = one.comparison.track.instance
    causes = (f.cause for f in one.verdict.findings if f.severity == "error" and f.side == "imu")
    return one.best is None or any(cause is None or cause.imu in (None, own) for cause in causes)


def _assessed(flight: Flight, settings: Settings, imu: str) -> Assessment | None:
    try:
        return assess_imu(flight, settings, imu=imu)
    except DataError:
        return None
