"""A flight examined as the settings say: the one set of numbers that terminal, JSON, page, report and fleet show.

And the lanes of its estimator, against the best estimate of an IMU that is in order where there is one; and what a
process takes of the computer for it: threads of BLAS, and memory that it needs no longer.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, cached_property, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import msgspec
import numpy as np

from companion.app.correction import load_correction
from companion.app.sensors import imu_spec_of, load_imu_spec
from companion.app.settings import Settings
from companion.comparison import (
    NO_CORRECTION,
    Alignment,
    Comparison,
    ImuNoise,
    ImuSpec,
    Integration,
    Limits,
    RedundantImu,
    ReferenceSpec,
    align,
    compare,
    each_imu,
    gravity_for,
    imu_noise,
    reported_by,
)
from companion.estimation import BestEstimate, Effort
from companion.model import DataError, Flight, NoEstimateError, SettingsError, brief
from companion.verdict import Assessment, Lanes, Verdict, assess, judge_lanes, known_share, verdict_without_imu

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function have one thread of BLAS while it runs.

    The matrices of an estimate are small: a second thread waits at full load, and where the other cores have work of
    their own everything takes several times as long. What the caller has set in OPENBLAS_NUM_THREADS holds.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if "OPENBLAS_NUM_THREADS" in os.environ:
            return function(*args, **kwargs)
        from threadpoolctl import threadpool_limits  # noqa: PLC0415  (the command line never needs it)

        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def give_back() -> None:
    """Give what was freed back to the operating system: glibc keeps it. Some milliseconds; elsewhere nothing is done.

    Source: malloc_trim(3).
    """
    if (trim := _trim()) is not None:
        trim(0)


@cache
def _trim() -> Any:
    if sys.platform != "linux":
        return None
    return getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none


@dataclass(frozen=True, eq=False)
class Examination:
    """One IMU of a flight assessed, and every other IMU beside it."""

    __repr__ = brief

    flight: Flight
    assessment: Assessment
    settings: Settings = field(repr=False)
    imu_model: str | None  # the part that was named
    correction: str | None  # the file that was applied
    alignment: Alignment | None  # the IMU aligned by itself at rest, where that was requested

    @property
    def verdict(self) -> Verdict:
        """That of the IMU that was used."""
        return self.assessment.verdict

    @cached_property
    def gaps(self) -> Mapping[str, int]:
        """Gaps of each IMU message."""
        return _gaps(self.flight, self.assessment.comparison.how.limits)

    @cached_property
    def redundant_imus(self) -> tuple[RedundantImu, ...]:
        """Every IMU, uncorrected: a correction is of one IMU. Computed when first used."""
        flight, own = self.flight, self.assessment.comparison

        def compared(name: str) -> Comparison:
            is_own = self.correction is None and own.track.source == name
            return own if is_own else compare(flight, imu=name, how=own.how)

        def spec(name: str) -> ImuSpec:
            return _spec(flight, name, self.imu_model)

        return each_imu(flight, compared, spec, autopilot_of(self.settings, flight))


@dataclass(frozen=True, slots=True, eq=False)
class Unexamined:
    """A flight that lacks what an examination needs."""

    flight: Flight
    verdict: Verdict  # what the rest of it says, what is missing, and what to ask for
    says_something: bool  # the rest of it; nothing was analysed otherwise
    gaps: Mapping[str, int]  # gaps of each IMU message


_DEFAULTS = Settings()


@one_blas_thread
def examine(
    flight: Flight,
    settings: Settings = _DEFAULTS,
    *,
    imu: str | None = None,
    imu_model: str | None = None,
    correction: str | Path | None = None,
    how: Integration | None = None,
    anchor: str = "autopilot",
    confusion: bool = False,
) -> Examination:
    """The whole analysis of a flight.

    imu: the message to integrate; imu_model: a part of config/imu in place of the one that the vehicle names;
    correction: a file of `companion calibrate`; how: in place of what the settings say; anchor: "rest" aligns the IMU
    by itself too; confusion: find out from which size on faults are identified among their rivals, which takes seconds.

    Raises DataError when the flight has no usable IMU, no attitude or, for that, no rest; InputError and SettingsError
    for files that cannot be read.

    >>> import companion as c
    >>> examined = c.examine(c.open_log("tlogs/copter-demo-100hz.tlog")[0], imu="SCALED_IMU2")
    >>> examined.assessment.verdict.status, examined.assessment.imu_spec.name
    ('consistent', 'generic-mems')
    >>> [(other.imu, other.drift.windows) for other in examined.redundant_imus]
    [('RAW_IMU', 20), ('SCALED_IMU2', 19)]
    """
    check_anchor(anchor)
    with _cannot_tell():
        chosen: dict[str, Any] = {"imu": imu, "imu_model": imu_model, "correction": correction, "how": how}
        assessment = assess_imu(flight, settings, confusion=confusion, **chosen)
        own, spec, autopilot = assessment.comparison, assessment.imu_spec, autopilot_of(settings, flight)
        aligned = align(flight, own, spec, autopilot) if anchor == "rest" else None
    file = None if correction is None else str(correction)
    return Examination(flight, assessment, settings, imu_model, file, aligned)


def check_anchor(anchor: str) -> None:
    """Raises SettingsError for what is no way to begin."""
    if anchor not in ("autopilot", "rest"):
        raise SettingsError(f'anchor is "autopilot" or "rest", got {anchor!r}.')


@contextlib.contextmanager
def _cannot_tell() -> Iterator[None]:
    """Equations that a flight does not determine are no error of its reader's."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise DataError(
            f"This flight cannot tell: its readings do not determine what is estimated ({error}). They are stuck, "
            "repeated or damaged: see what the log has with companion info, and try another --imu."
        ) from None


def unexaminable(flight: Flight, settings: Settings = _DEFAULTS) -> Unexamined | None:
    """Why a flight cannot be examined: it has no usable IMU or no attitude. None when it has both."""
    try:
        flight.imu()
        flight.require_attitude()
    except DataError as error:
        limits = limits_of(settings)
        verdict = verdict_without_imu(flight, str(error), limits)
        nothing = Verdict("insufficient_data", f"Cannot tell: {error}", ())
        return Unexamined(flight, verdict or nothing, verdict is not None, _gaps(flight, limits))
    return None


def examined_or_not(flight: Flight, settings: Settings = _DEFAULTS, **chosen: Any) -> Examination | Unexamined:
    """The examination of a flight, or what is left to say of one that cannot be examined: as `examine`."""
    return unexaminable(flight, settings) or examine(flight, settings, **chosen)


@_cannot_tell()
def assess_imu(
    flight: Flight,
    settings: Settings,
    *,
    imu: str | None = None,
    imu_model: str | None = None,
    correction: str | Path | None = None,
    how: Integration | None = None,
    before: BestEstimate | None = None,
    confusion: bool = False,
    effort: Effort = Effort(),  # noqa: B008  (frozen)
) -> Assessment:
    """One IMU of a flight alone, without the others. Arguments and errors as `examine`.

    before, confusion, effort: as `companion.estimation.smooth` has them.
    """
    name = flight.imu(imu).source
    return assess(
        flight,
        _spec(flight, name, imu_model),
        autopilot=autopilot_of(settings, flight),
        horizons=settings.drift.horizons_s,
        imu=name,
        how=how or integration_of(settings, flight),
        correction=NO_CORRECTION if correction is None else load_correction(correction),
        before=before,
        confusion=confusion,
        effort=effort,
    )


@_cannot_tell()
def align_imu(
    flight: Flight,
    settings: Settings,
    *,
    imu: str | None = None,
    imu_model: str | None = None,
    how: Integration | None = None,
) -> Alignment:
    """One IMU aligned by itself at rest. Arguments and errors as `examine`."""
    track = flight.imu(imu)
    comparison = compare(flight, track=track, how=how or integration_of(settings, flight))
    return align(flight, comparison, _spec(flight, track.source, imu_model), autopilot_of(settings, flight))


def noise_of(
    flight: Flight, settings: Settings = _DEFAULTS, *, imu: str | None = None, imu_model: str | None = None
) -> ImuNoise:
    """The noise of one IMU at rest and in flight. Arguments and errors as `examine`; it needs no attitude."""
    name = flight.imu(imu).source
    return imu_noise(flight, name, _spec(flight, name, imu_model), limits_of(settings))


def integration_of(settings: Settings, flight: Flight) -> Integration:
    """How the settings have an IMU of this flight integrated: gravity may depend on where it flew."""
    chosen = msgspec.structs.asdict(settings.integration)
    gravity = gravity_for(flight, chosen.pop("gravity"))
    return Integration(**chosen, gravity=gravity, limits=limits_of(settings))


def limits_of(settings: Settings) -> Limits:
    """What the settings leave out of the windows."""
    return Limits(**{limit.name: getattr(settings.drift, limit.name) for limit in fields(Limits)})


def autopilot_of(settings: Settings, flight: Flight) -> ReferenceSpec:
    """How far the settings, or the vehicle's own variances, let the autopilot be off."""
    given = msgspec.structs.asdict(settings.autopilot)
    reported = given.pop("reported")
    spec = ReferenceSpec(**given)
    return reported_by(flight, spec) if reported else spec


def _gaps(flight: Flight, limits: Limits) -> dict[str, int]:
    return {name: int((np.diff(track.t) > limits.longest_step(track.t)).sum()) for name, track in flight.imus.items()}


def _spec(flight: Flight, imu: str, imu_model: str | None) -> ImuSpec:
    """The noise specification that was requested, else that of the part that the vehicle names."""
    return load_imu_spec(imu_model) if imu_model else imu_spec_of(flight, imu)


@one_blas_thread
def lanes_of(flight: Flight, settings: Settings, own: Assessment | None = None) -> tuple[Lanes, BestEstimate]:
    """Every lane judged, and the best estimate that they were judged by. own: of the flight, where it has been made.

    An estimate that has an error of its own IMU explained away is not known as well as that of an IMU that is in order.
    Raises NoEstimateError where no IMU carries an estimate, and DataError as `examine`.
    """
    first = own or assess_imu(flight, settings)
    used = flight.imu(first.comparison.track.source)
    by = first
    if first.best is None or used.instance in _accused(first):
        names = [one.source for one in flight.each_imu() if one.instance != used.instance]
        assessed = [one for name in names if (one := _assessed(flight, settings, name)) is not None]
        others = [one for one in assessed if not any(f.kind == "rate_too_low" for f in one.verdict.findings)]
        every = [first, *others]
        votes = Counter(number for one in every for number in _accused(one))
        by = max((one for one in every if one.best is not None), key=lambda one: _worth(one, votes), default=first)
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


def _worth(one: Assessment, votes: Counter[int]) -> tuple[int, float]:
    """How good an IMU is to carry the estimate: the fewer of all estimates accuse it the better."""
    assert one.best is not None
    return -votes[one.comparison.track.instance], known_share(one.best)


def _accused(one: Assessment) -> set[int]:
    """The IMUs that are at fault by one assessment."""
    own = one.comparison.track.instance
    causes = [f.cause for f in one.verdict.findings if f.severity == "error" and f.side == "imu"]
    return {own if cause is None or cause.imu is None else cause.imu for cause in causes}


def _assessed(flight: Flight, settings: Settings, imu: str) -> Assessment | None:
    try:
        return assess_imu(flight, settings, imu=imu)
    except DataError:
        return None
