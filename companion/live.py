"""The flight twice while it happens: the newest seconds of a stream, replayed by the same function as a log."""

from __future__ import annotations

from dataclasses import dataclass

from companion.analysis import Integration, Replay, replay
from companion.errors import DataError
from companion.telemetry import Stream
from companion.tracks import Flight

_MARGIN_S = 3.0  # beside the re-anchor period: late packets, and the autopilot's messages around the anchor


@dataclass(frozen=True, slots=True, eq=False)
class Present:
    """Where a live flight stands."""

    flight: Flight  # its last seconds
    replay: Replay  # since the anchor before the last; its last row is now


class LiveReplay:
    """Both poses of a stream's vehicle, now: `look` as often as something is to be shown.

    vehicle: SYSID or SYSID:COMPID; None: the one with the most IMU samples. The other options are those of `replay`.
    The reckoning starts again from the autopilot every `reanchor_s`, at the times at which that of the whole flight
    would, give or take a sample; after a reboot at the first state that is known.
    """

    def __init__(
        self,
        stream: Stream,
        *,
        vehicle: str | None = None,
        imu: str | None = None,
        how: Integration | None = None,
        reanchor_s: float = 10.0,
    ) -> None:
        if not reanchor_s > 0:
            raise ValueError(f"the re-anchor period must be positive seconds, got {reanchor_s}")
        self.why_not = "nothing has been received"  # why the last `look` found nothing, for the user
        self._stream = stream
        self._vehicle = vehicle
        self._imu = imu
        self._how = how or Integration()
        self._reanchor_s = reanchor_s
        self._boot: tuple[str, int] | None = None
        self._anchor: float | None = None  # s, boot clock

    def anchor_now(self) -> None:
        """Start again from the autopilot at the next look."""
        self._anchor = None

    def look(self) -> Present | None:
        """Both poses over the last seconds; None, with the reason in `why_not`, when they cannot be known."""
        flight = self._choose()
        if flight is None:
            return None
        boot = (str(flight.vehicle), flight.boot)
        if boot != self._boot:
            self._boot, self._anchor = boot, None
        start = self._anchor
        if start is None or start < flight.start + flight.duration - self._span:
            start = _nearly_now(flight)
        try:
            both = replay(
                flight,
                imu=self._imu,
                how=self._how,
                reanchor_s=self._reanchor_s,
                start_s=start,
            )
        except DataError as reason:
            self.why_not = str(reason)
            return None
        # one anchor back, so that the last error before a new anchor is still shown with it
        self._anchor = float(both.anchors[-2 if len(both.anchors) > 1 else -1])
        self.why_not = ""
        return Present(flight, both)

    @property
    def _span(self) -> float:
        return 2 * self._reanchor_s + _MARGIN_S

    def _choose(self) -> Flight | None:
        found = self._stream.recent(self._span)
        if self._vehicle is not None:
            found = [f for f in found if self._vehicle in (str(f.vehicle), str(f.vehicle.sysid))]
        newest = {f.vehicle.sysid: f for f in found}  # the last boot of each
        usable = [f for f in newest.values() if f.default_imu is not None]
        if not usable:
            self.why_not = "no IMU messages" if newest else "no vehicle is heard"
            return None
        return max(usable, key=lambda f: len(f.imus[f.default_imu or ""]))


def _nearly_now(flight: Flight) -> float | None:
    """Where to begin when no anchor is in force, s: a second before the newest attitude."""
    return float(flight.attitude.t[-1]) - 1.0 if flight.attitude is not None else None
