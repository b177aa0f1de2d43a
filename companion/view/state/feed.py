"""What the live page is given: everything that is known of a link and of the vehicle on it, as plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from companion.analysis import DriftRow, FreeState, LiveVerdict, Preflight, Replay
from companion.model import Flight
from companion.view.state.choice import ReplayChoice


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A vehicle now."""

    flight: Flight  # its last seconds
    imu: str  # the message that is integrated
    replay: Replay  # since the anchor before the last; its last row is now
    free: FreeState | None  # the IMU left alone since an anchor; None just after such a run has ended


@dataclass(frozen=True, slots=True)
class StreamState:
    """One message that is requested of the vehicle."""

    name: str
    requested_hz: float
    received_hz: float
    note: str = ""  # "given up", "asking"; "" when it is agreed


@dataclass(frozen=True, slots=True)
class LinkState:
    """How a link stands. All text is untrusted."""

    link: str
    problem: str = ""  # why nothing is received at present; "" while frames arrive
    streams: tuple[StreamState, ...] = ()
    frames: int = 0
    lost: Mapping[str, float] = field(default_factory=dict)  # vehicle → share of its frames missing by sequence
    rejected: int = 0  # frames whose signature is missing or wrong
    latency_ms: float | None = None  # half of the way there and back
    clock: str = ""  # what is known of the vehicle's clock, in words
    recording: str = ""  # file; "" for none
    recorded_bytes: int = 0
    recording_problem: str = ""


class Feed(Protocol):
    """Where the live page looks. Everything but `wait` answers at once, and all is called by the view thread alone."""

    reanchor_s: float  # the dead reckoning restarts from the autopilot so often

    @property
    def choice(self) -> ReplayChoice:
        """Which IMU is integrated, and how; a change begins the free run and the drift anew."""

    def choose(self, choice: ReplayChoice) -> None:
        """Integrate another one, or otherwise."""

    @property
    def why_not(self) -> str:
        """Why the last look saw nothing, or the last free run ended."""

    @property
    def vehicles(self) -> Sequence[str]:
        """Those that can be looked at."""

    @property
    def messages(self) -> Sequence[str]:
        """The last sentences for the user, the newest last."""

    @property
    def link(self) -> LinkState:
        """How the link stands."""

    @property
    def drift(self) -> Sequence[DriftRow]:
        """The drift since the first message of the vehicle."""

    @property
    def verdict(self) -> LiveVerdict:
        """The verdict now and so far, of the vehicle that is looked at."""

    @property
    def other_verdicts(self) -> Sequence[LiveVerdict]:
        """Those on the other vehicles of the link."""

    @property
    def preflight(self) -> Preflight | None:
        """The checks before take-off, while the vehicle that is looked at stands disarmed."""

    def wait(self, timeout_s: float) -> None:
        """Wait until there is something that `look` has not seen, no longer than so many s."""

    def look(self) -> Seen | None:
        """The vehicle now."""

    def pick(self, vehicle: str) -> None:
        """Look at another vehicle from now on."""

    def anchor_now(self) -> None:
        """Restart both dead reckonings from the autopilot."""
