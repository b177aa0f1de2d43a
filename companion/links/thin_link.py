"""Whether a link carries what was agreed: a radio behind UDP says nothing of how much it takes."""

from __future__ import annotations

from collections.abc import Sequence

from companion.links.request_table import SHARE, fit, load
from companion.links.stream_request import StreamRequest
from companion.mavlink import Dialect

_LOOK_S = 5.0  # over which rates are measured
_ENOUGH = 0.6  # of the bytes agreed: less is a link that does not carry them
_SHORT = 0.8  # of its own rate: a message of which less comes
_MOST = 0.75  # of the bytes are of messages that are short at once: one that another program overrides is short alone
_LOST = 0.1  # share of the frames that a link loses which is too full
_LOOKS = 2  # in a row
_FITS = 0.9  # of what arrived


class ThinLink:
    """Looks at what arrives; says what would fit where too little does.

    scales: whether the autopilot itself sends less of everything where a link is too slow (PX4), so that nothing is
    lost. Of ArduPilot that is a download of parameters, or another program's stream rates.
    """

    def __init__(self, dialect: Dialect, *, scales: bool) -> None:
        self._scales = scales
        self._dialect = dialect
        self._due: float | None = None  # s
        self._looks = 0  # in a row at which too little has come

    def start_again(self) -> None:
        """Nothing is known any more: what is agreed begins anew."""
        self._due, self._looks = None, 0

    def fitting(
        self, stream_requests: Sequence[StreamRequest], lost: float, now: float
    ) -> tuple[dict[str, float], str]:
        """Message → Hz that would fit, and a sentence; empty where nothing is to be lowered.

        lost: the share of the vehicle's frames that is missing by their sequence.
        """
        if self._due is None or now < self._due:
            self._due = self._due or now + 2 * _LOOK_S
            return {}, ""
        self._due = now + _LOOK_S
        coming = [one for one in stream_requests if one.received_hz]
        agreed = {one.name: one.requested_hz for one in coming}
        arrives = load({one.name: min(one.received_hz, one.requested_hz) for one in coming}, self._dialect)
        short = {one.name: one.requested_hz for one in coming if one.received_hz < _SHORT * one.requested_hz}
        needed, full = load(agreed, self._dialect), lost > _LOST or self._scales
        thin = full and arrives < _ENOUGH * needed and load(short, self._dialect) >= _MOST * needed
        self._looks = self._looks + 1 if thin else 0
        if self._looks < _LOOKS:
            return {}, ""
        self.start_again()
        carries = _FITS * arrives / SHARE
        left, words = fit(agreed, self._dialect, carries, "Whoever shares the link has the rest.")
        return {name: left.get(name, min(hz, 1.0)) for name, hz in agreed.items()}, words
