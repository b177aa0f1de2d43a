"""What a user can ask of the view: small messages from the browser's callbacks to the one thread that acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from companion.view.choice import ReplayChoice
from companion.view.framing import CameraMode


@dataclass(frozen=True, slots=True)
class Toggle:
    """Play or pause."""


@dataclass(frozen=True, slots=True)
class Seek:
    """Go to a time, s since the flight's start."""

    seconds: float


@dataclass(frozen=True, slots=True)
class SeekShare:
    """Go to a share (0 ... 1) of the whole."""

    share: float


@dataclass(frozen=True, slots=True)
class Step:
    """Pause and move by so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Play so many times as fast as it was flown."""

    speed: float


@dataclass(frozen=True, slots=True)
class SetLoop:
    """Start over at the end, or stop there."""

    loop: bool


@dataclass(frozen=True, slots=True)
class Choose:
    """Reckon otherwise."""

    choice: ReplayChoice


@dataclass(frozen=True, slots=True)
class StartHere:
    """Reckon from the instant shown."""


@dataclass(frozen=True, slots=True)
class PickFlight:
    """Show another flight, by its place in the list."""

    index: int


@dataclass(frozen=True, slots=True)
class SetCamera:
    """Move the camera otherwise."""

    mode: CameraMode


@dataclass(frozen=True, slots=True)
class SetTrail:
    """Show the paths of the last so many seconds (None: since the start), or the whole of them."""

    seconds: float | None
    ahead: bool = False


@dataclass(frozen=True, slots=True)
class SetSize:
    """Draw the drones so large; None: as large as they are."""

    size: float | None


@dataclass(frozen=True, slots=True)
class SetDark:
    """Dark or light page."""

    dark: bool


@dataclass(frozen=True, slots=True)
class Joined:
    """Another browser has opened the page."""


Event = (
    Toggle
    | Seek
    | SeekShare
    | Step
    | SetSpeed
    | SetLoop
    | Choose
    | StartHere
    | PickFlight
    | SetCamera
    | SetTrail
    | SetSize
    | SetDark
    | Joined
)
Post = Callable[[Event], None]
