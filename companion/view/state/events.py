"""What a user can ask of the view: small messages from the browser's callbacks to the one thread that acts.

`browser` is the number that viser gives each page that is open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from companion.view.state.choice import ReplayChoice

Kept = Literal["picture", "page", "report"]
CameraMode = Literal["Free", "Follow", "Chase", "From above", "Map"]
ExtraPath = Literal["gps", "best"]
SHOWN: dict[ExtraPath, bool] = {"gps": True, "best": False}
"""Which of the extra paths are shown at first."""


@dataclass(frozen=True, slots=True)
class Toggle:
    """Play or pause."""


@dataclass(frozen=True, slots=True)
class Seek:
    """Go to a time, s, boot clock."""

    t: float


@dataclass(frozen=True, slots=True)
class SeekShare:
    """Go to a share (0 ... 1) of the part that is played."""

    share: float


@dataclass(frozen=True, slots=True)
class Step:
    """Pause and move by so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class StepSample:
    """Pause and move by so many IMU samples, forward or back."""

    samples: int


@dataclass(frozen=True, slots=True)
class Jump:
    """Pause and go to the next anchor or mark, or to the one before."""

    to: Literal["anchor", "mark"]
    forward: bool


@dataclass(frozen=True, slots=True)
class JumpToMark:
    """Pause and go to a mark, by its place in the list."""

    index: int


@dataclass(frozen=True, slots=True)
class JumpToFinding:
    """Pause and go to where a finding begins, by its place in the verdict."""

    index: int


@dataclass(frozen=True, slots=True)
class PickPlace:
    """Pause and go to the place of a path that was clicked on: a ray in a browser's own world, m."""

    browser: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Play so many times as fast as it was flown."""

    speed: float


@dataclass(frozen=True, slots=True)
class SetLoop:
    """Start again where the part ends, or stop there."""

    loop: bool


@dataclass(frozen=True, slots=True)
class SetBackwards:
    """Let time run backwards, or forwards."""

    backwards: bool


@dataclass(frozen=True, slots=True)
class SetPart:
    """Play and plot only what comes from the instant shown on, or up to it, or the whole again."""

    edge: Literal["from", "to", "whole"]


@dataclass(frozen=True, slots=True)
class Choose:
    """Reckon what a link sends otherwise."""

    choice: ReplayChoice


@dataclass(frozen=True, slots=True)
class Change:
    """Reckon otherwise in one respect; in all others as was asked for last, whether it is already shown or not."""

    change: Callable[[ReplayChoice], ReplayChoice]


@dataclass(frozen=True, slots=True)
class StartHere:
    """Reckon from the instant shown."""


@dataclass(frozen=True, slots=True)
class PickFlight:
    """Show another flight, by its place in the list."""

    index: int


@dataclass(frozen=True, slots=True)
class PickCharts:
    """Show another page of charts, by its name."""

    page: str


@dataclass(frozen=True, slots=True)
class SetCamera:
    """Move one browser's camera otherwise."""

    browser: int
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
class SetRange:
    """Draw the ellipsoid of three expected standard deviations, or not."""

    shown: bool


@dataclass(frozen=True, slots=True)
class SetArrows:
    """Draw velocity and gravity as arrows, or not."""

    shown: bool


@dataclass(frozen=True, slots=True)
class SetPath:
    """Draw one of the extra paths, or not."""

    name: ExtraPath
    shown: bool


@dataclass(frozen=True, slots=True)
class SetMap:
    """Lay a map under the flight, or not: it is fetched from the network."""

    shown: bool


@dataclass(frozen=True, slots=True)
class SetDark:
    """Dark or light page."""

    dark: bool


@dataclass(frozen=True, slots=True)
class Save:
    """Send one browser the picture it shows as PNG, the 3D replay as a page of its own, or the report."""

    browser: int
    what: Kept


@dataclass(frozen=True, slots=True)
class Visit:
    """Somebody opens an address that asks for an instant (s, boot clock) and an IMU. Untrusted text; "" for none."""

    t: str
    imu: str
    again: bool = False  # nobody has asked: the page remembers what it showed last of this log


@dataclass(frozen=True, slots=True)
class Joined:
    """Another browser has opened the page."""

    browser: int


@dataclass(frozen=True, slots=True)
class Left:
    """A browser has closed the page, or lost it."""

    browser: int


@dataclass(frozen=True, slots=True)
class Pause:
    """Hold the live picture while the recording goes on, or follow it again; None: whichever it is not."""

    paused: bool | None = None


@dataclass(frozen=True, slots=True)
class LookBack:
    """Hold the live picture and show the instant so many seconds before its end (0 or less)."""

    seconds: float


@dataclass(frozen=True, slots=True)
class StepBack:
    """Hold the live picture and move by so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class SetReanchor:
    """Start again from the autopilot every so many seconds."""

    seconds: float


@dataclass(frozen=True, slots=True)
class AnchorNow:
    """Start again from the autopilot at once."""


@dataclass(frozen=True, slots=True)
class PickVehicle:
    """Look at another vehicle of the link."""

    vehicle: str


@dataclass(frozen=True, slots=True)
class PickRun:
    """Show the charts of the free run, or those since the last anchor."""

    free: bool


Look = SetCamera | SetSize | SetRange | SetArrows | SetPath | SetMap | SetDark | Joined | Left
Goto = Step | StepSample | Jump | JumpToMark | JumpToFinding
Move = Toggle | Seek | SeekShare | Goto | SetSpeed | SetLoop | SetBackwards | SetPart
Live = Pause | LookBack | StepBack | SetReanchor | AnchorNow | PickVehicle | PickRun
Event = Live | Move | Look | SetTrail | Choose | Change | StartHere | PickFlight | PickCharts | PickPlace | Save | Visit
Post = Callable[[Event], None]
