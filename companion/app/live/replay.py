"""The flight twice while it happens: the newest seconds of a stream, replayed by the same function as a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from companion.analysis import Continued, Integration, Replay, extend, replay
from companion.model import DataError, Flight, check_seconds
from companion.telemetry import Stream

_MARGIN_S = 3.0  # beside the re-anchor period: late packets, and the autopilot's messages around the anchor

_WHOLE_S = 4.0  # between two looks at everything; in between the newest samples go on from the last
_OVERLAP_S = 0.6  # of arrivals before that: a sample or more of each message, also of slow ones

_STEADY_S = 5.0  # how long another IMU message must be the better one


@dataclass(frozen=True, slots=True, eq=False)
class Present:
    """Where a live flight stands."""

    flight: Flight  # its last seconds
    imu: str  # the message that is integrated
    replay: Replay  # since the anchor before the last, or only the last rows; its last row is now
    continued: Continued | None  # those last rows; None where everything was looked at


@dataclass(frozen=True, slots=True, eq=False)
class _Whole:
    """A look at everything."""

    present: Present
    how: Integration
    newest: float  # s UNIX, when the newest message of then arrived
    requested: tuple[object, ...]


class LiveReplay:
    """Both poses of a stream's vehicle, now: `look` as often as something is to be shown.

    vehicle: SYSID or SYSID:COMPID; None: the one with the most IMU samples. how: how to integrate, or a function that
    says so for a flight. The other options are those of `replay`; all but the stream may be changed at any time.
    Dead reckoning starts again from the autopilot every `reanchor_s`, at the times at which that of the whole flight
    would, give or take a sample; after a reboot at the first state that is known.
    """

    def __init__(
        self,
        stream: Stream,
        *,
        vehicle: str | None = None,
        imu: str | None = None,
        how: Integration | Callable[[Flight], Integration] = Integration(),  # noqa: B008  (frozen)
        reanchor_s: float = 10.0,
    ) -> None:
        self.vehicle = vehicle
        self.vehicles: tuple[str, ...] = ()  # those with an IMU at the last look
        self.reanchor_s = reanchor_s
        self.why_not = "nothing has been received"  # why the last `look` found nothing, for the user
        self._stream = stream
        self.imu = imu
        self.how = how
        self._whole: _Whole | None = None
        self._boot: tuple[str, int] | None = None
        self._anchor: float | None = None  # s, boot clock
        self._chosen: str | None = None  # the IMU that is shown when the user names none
        self._doubted: float | None = None  # s, boot clock, since when another would be the default

    @property
    def reanchor_s(self) -> float:
        """The re-anchor period, s. Raises SettingsError for one that is not positive."""
        return self._reanchor_s

    @reanchor_s.setter
    def reanchor_s(self, seconds: float) -> None:
        check_seconds("the re-anchor period", seconds)
        self._reanchor_s = seconds

    def anchor_now(self) -> None:
        """Start again from the autopilot at the next look."""
        self._anchor = self._whole = None

    def look(self) -> Present | None:
        """Both poses over the last seconds; None, with the reason in `why_not`, when they cannot be known."""
        return self._gone_on() or self._look_at_everything()

    def _gone_on(self) -> Present | None:
        """The last look at everything carried on; None where it is time for another, or nothing else can tell."""
        whole = self._whole
        if whole is None or whole.requested != self._requested or self._stream.newest - whole.newest > _WHOLE_S:
            return None
        present = whole.present
        newest = self._stream.extend(present.flight, present.imu, whole.newest - _OVERLAP_S)
        if newest is None:
            return None
        continued = extend(present.replay, newest.imu, newest.attitude, newest.position, whole.how)
        if continued is None or continued.replay.t[-1] >= present.replay.anchors[-1] + self._reanchor_s:
            return None
        return Present(present.flight, present.imu, continued.replay, continued)

    @property
    def _requested(self) -> tuple[object, ...]:
        """What the user wants to see: another wish is another look."""
        return self.vehicle, self.imu, self.how, self._reanchor_s

    def _look_at_everything(self) -> Present | None:
        self._whole = None
        flight = self._choose()
        if flight is None:
            return None
        boot = (str(flight.vehicle), flight.boot)
        if boot != self._boot:
            self._boot, self._anchor, self._chosen = boot, None, None
        imu = self.imu or self._steady_imu(flight)
        how = self.how(flight) if callable(self.how) else self.how
        start = self._anchor
        if start is None or start < flight.start + flight.duration - self._span:
            start = _nearly_now(flight)
        try:
            both = replay(flight, imu=imu, how=how, reanchor_s=self._reanchor_s, start_s=start)
        except DataError as reason:
            self.why_not = str(reason)
            return None
        # one anchor back, so that the last error before a new anchor is still shown with it
        self._anchor = float(both.anchors[-2 if len(both.anchors) > 1 else -1])
        self.why_not = ""
        present = Present(flight, flight.imu(imu).source, both, None)
        self._whole = _Whole(present, how, self._stream.newest, self._requested)
        return present

    @property
    def _span(self) -> float:
        return 2 * self._reanchor_s + _MARGIN_S

    def _choose(self) -> Flight | None:
        recent = self._stream.recent(self._span)
        newest = {f.vehicle.sysid: f for f in recent}  # the last boot of each
        usable = [f for f in newest.values() if f.default_imu is not None]
        self.vehicles = tuple(str(f.vehicle) for f in usable)
        if self.vehicle is not None:
            usable = [f for f in usable if self.vehicle in (str(f.vehicle), str(f.vehicle.sysid))]
        if not usable:
            self.why_not = "no IMU messages" if newest else "no vehicle on the link"
            return None
        shown = self._boot[0] if self._boot else ""  # two vehicles that send alike must not take turns
        return max(usable, key=lambda f: (str(f.vehicle) == shown, len(f.imus[f.default_imu or ""])))

    def _steady_imu(self, flight: Flight) -> str | None:
        """The flight's default; another than before only when it has been that for a while: losses come and go."""
        default, now = flight.default_imu, flight.start + flight.duration
        if default == self._chosen:
            self._doubted = None
        elif self._chosen not in flight.imus or (self._doubted is not None and now - self._doubted > _STEADY_S):
            self._chosen, self._doubted, self._anchor = default, None, None
        elif self._doubted is None:
            self._doubted = now
        return self._chosen


def _nearly_now(flight: Flight) -> float | None:
    """Where to begin when no anchor is in force, s: a second before the newest attitude."""
    return float(flight.attitude.t[-1]) - 1.0 if flight.attitude is not None else None
