"""What can be pressed, chosen and read beside the picture. Every press becomes an event for the view thread."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Literal

import viser

from companion.tracks import Flight
from companion.view import events, palette
from companion.view.choice import ReplayChoice
from companion.view.framing import CAMERA_MODES
from companion.view.moment import Moment
from companion.view.palette import Rgb
from companion.view.player import Player

Key = Literal["space", "arrowleft", "arrowright", "home", "end"]
SPEEDS = ("0.1×", "0.2×", "0.5×", "1×", "2×", "5×", "10×", "20×", "50×")
METHODS = {"RK4 (most exact)": "rk4", "Midpoint": "midpoint", "Euler (simplest)": "euler"}
MIDDLES = {"Straight lines (linear)": "linear", "Curves (cubic)": "cubic"}
TRAILS = {
    "Path so far": events.SetTrail(None),
    "Last 10 s": events.SetTrail(10.0),
    "Last 30 s": events.SetTrail(30.0),
    "Whole path": events.SetTrail(None, ahead=True),
}
SIZES = {"Easy to see": 1.0, "Larger": 1.7, "Smaller": 0.5, "True size": None}
STEPS = {"Start": None, "−10": -10.0, "−1": -1.0, "+1": 1.0, "+10": 10.0}


class Panel:
    """The controls. Built once; `load` fits them to a flight, `show` writes the instant into them.

    `post` is called in the server's event loop and must not block.
    """

    def __init__(self, gui: viser.GuiApi, flights: Sequence[Flight], post: events.Post) -> None:
        self._post = post
        self._flight = flights[0]
        self._legend = gui.add_html("")
        self._numbers = gui.add_html("")
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
        self._steps = gui.add_button_group("Step, s", tuple(STEPS), hint="Arrow keys: 1 s; Home, End: the ends")
        self._time = gui.add_slider("Time, s", 0.0, 1.0, 0.01, 0.0, hint="Seconds since the flight's first message")
        self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1×")
        self._loop = gui.add_checkbox("Repeat", False)
        with gui.add_folder("Reckoning from the IMU"):
            names = tuple(f"{i + 1}: {_title(f)}" for i, f in enumerate(flights))
            self._pick = gui.add_dropdown("Flight", names, visible=len(flights) > 1)
            self._imu = gui.add_dropdown("IMU", ("none",))
            self._method = gui.add_dropdown("Integrator", tuple(METHODS))
            self._middle = gui.add_dropdown(
                "Joined by", tuple(MIDDLES), hint="How the readings are taken to run from one sample to the next"
            )
            self._anchored = gui.add_checkbox(
                "Re-anchor", True, hint="Start again from the autopilot's state, over and over; off: run free"
            )
            self._period = gui.add_number("every, s", 10.0, min=0.5, max=3600.0, step=0.5)
            self._start = gui.add_number("from, s", 0.0, min=0.0, step=0.1, hint="Seconds since the flight's start")
            self._here = gui.add_button("Start from the instant shown", icon=viser.Icon.ANCHOR)
            self._status = gui.add_html("")
        with gui.add_folder("Picture"):
            self._camera = gui.add_dropdown("Camera", CAMERA_MODES)
            self._trail = gui.add_dropdown("Paths", tuple(TRAILS))
            self._size = gui.add_dropdown("Drones", tuple(SIZES))
            self._dark = gui.add_checkbox("Dark", False)
        self._listen()
        self._bind_keys(gui)

    def load(self, flight: Flight, choice: ReplayChoice, player: Player, cell: float, has_position: bool) -> None:
        """Fit the controls to what is shown now. Values set here come back as no events."""
        self._flight = flight
        self._legend.content = _legend(flight, cell, has_position)
        self._imu.options = tuple(flight.imus) or ("none",)
        if choice.imu is not None and choice.imu in flight.imus:
            _write(self._imu, choice.imu)
        _write(self._method, _key(METHODS, choice.method))
        _write(self._middle, _key(MIDDLES, choice.middle))
        _write(self._anchored, choice.reanchor_s is not None)
        self._period.visible = choice.reanchor_s is not None
        if choice.reanchor_s is not None:
            _write(self._period, choice.reanchor_s)
        first = player.start if choice.start_s is None else choice.start_s
        _write(self._start, round(max(first - flight.start, 0.0), 3))
        low, high = round(player.start - flight.start, 2), round(player.end - flight.start, 2)
        # The bounds move one at a time and must never cross, and the value must always lie between them.
        self._time.max = max(high, self._time.max)
        self._time.min = low
        _write(self._time, round(player.time - flight.start, 2))
        self._time.max = high

    def show(self, moment: Moment, player: Player, has_position: bool) -> None:
        """Write the instant into the numbers, the slider and the play button."""
        now = moment.t - self._flight.start
        _write(self._time, round(now, 2))
        label = "Pause" if player.playing else "Play"
        if self._play.label != label:
            self._play.label = label
            self._play.icon = viser.Icon.PLAYER_PAUSE if player.playing else viser.Icon.PLAYER_PLAY
        self._numbers.content = _numbers(moment, now, has_position)

    def status(self, text: str, *, trouble: bool = False) -> None:
        """Say what the reckoning is doing, or why it failed. `text` may hold anything."""
        colour = palette.css(palette.IMU) if trouble else "inherit"
        html = f'<div style="padding:0 1em 0.5em;font-size:0.8em;color:{colour}">{escape(text)}</div>' if text else ""
        if self._status.content != html:
            self._status.content = html

    def _listen(self) -> None:
        post = self._post
        self._on(self._time, lambda: events.Seek(float(self._time.value)))
        self._on(self._speed, lambda: events.SetSpeed(float(self._speed.value.rstrip("×"))))
        self._on(self._loop, lambda: events.SetLoop(self._loop.value))
        self._on(self._pick, lambda: events.PickFlight(int(self._pick.value.split(":")[0]) - 1))
        self._on(self._camera, lambda: events.SetCamera(self._camera.value))
        self._on(self._trail, lambda: TRAILS[self._trail.value])
        self._on(self._size, lambda: events.SetSize(SIZES[self._size.value]))
        self._on(self._dark, lambda: events.SetDark(self._dark.value))
        for handle in (self._imu, self._method, self._middle, self._anchored, self._period, self._start):
            self._on(handle, lambda: events.Choose(self._choice()))

        @self._play.on_click
        async def _(_: object) -> None:
            post(events.Toggle())

        @self._here.on_click
        async def _(_: object) -> None:
            post(events.StartHere())

        @self._steps.on_click
        async def _(_: object) -> None:
            seconds = STEPS[self._steps.value]
            post(events.SeekShare(0.0) if seconds is None else events.Step(seconds))

    def _on(self, handle: Any, event: Callable[[], events.Event]) -> None:
        """Post `event` when a browser changes `handle`; what this thread writes itself is no event."""

        async def changed(update: Any) -> None:
            if update.client_id is not None:
                self._post(event())

        handle.on_update(changed)

    def _choice(self) -> ReplayChoice:
        """What the controls say. A browser may send anything: names are looked up, numbers kept in bounds."""
        return ReplayChoice(
            imu=self._imu.value if self._imu.value in self._flight.imus else None,
            method=METHODS.get(self._method.value, "rk4"),
            middle=MIDDLES.get(self._middle.value, "cubic"),
            reanchor_s=_bounded(self._period.value, 0.5, 10.0, 3600.0) if self._anchored.value else None,
            start_s=self._flight.start + _bounded(self._start.value, 0.0, 0.0, self._flight.duration),
        )

    def _bind_keys(self, gui: viser.GuiApi) -> None:
        """Keys go through the command palette, which lists them under Ctrl-K."""
        keys: list[tuple[str, Key, events.Event]] = [
            ("Play or pause", "space", events.Toggle()),
            ("Back 1 s", "arrowleft", events.Step(-1.0)),
            ("Forward 1 s", "arrowright", events.Step(1.0)),
            ("To the start", "home", events.SeekShare(0.0)),
            ("To the end", "end", events.SeekShare(1.0)),
        ]
        for label, key, event in keys:
            self._command(gui, label, key, event)

    def _command(self, gui: viser.GuiApi, label: str, key: Key, event: events.Event) -> None:
        @gui.add_command(label, hotkey=key).on_trigger
        async def _(_: object) -> None:
            self._post(event)


def _write(handle: Any, value: object) -> None:
    """Set an input's value. Untyped, because viser declares the setter where mypy does not see it."""
    handle.value = value


def _bounded(value: object, low: float, default: float, high: float) -> float:
    """`value` within bounds, or `default` for what is no number."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return default
    return min(max(float(value), low), high)


def _title(flight: Flight) -> str:
    vehicle = flight.vehicle
    return f"vehicle {vehicle}, boot {flight.boot}, {flight.duration:.0f} s"


def _key(options: dict[str, str], value: str) -> str:
    return next(key for key, meaning in options.items() if meaning == value)


def _swatch(colour: Rgb, opacity: float = 1.0, shape: str = "width:0.8em;height:0.8em;border-radius:50%") -> str:
    return (
        f'<span style="display:inline-block;{shape};margin-right:0.5em;vertical-align:middle;'
        f'background:{palette.css(colour)};opacity:{opacity}"></span>'
    )


def _legend(flight: Flight, cell: float, has_position: bool) -> str:
    """Who is who. Text that came from the vehicle is escaped: it is untrusted, and this is markup."""
    vehicle = flight.vehicle
    autopilot = {"ARDUPILOTMEGA": "ArduPilot"}.get(vehicle.autopilot, vehicle.autopilot)
    who = escape(f"{autopilot} {vehicle.type.lower()}".replace("_", " "))
    line = "width:1em;height:0.25em"
    rows = [
        f"{_swatch(palette.IMU)}<b>Solid: the IMU alone</b>, reckoned from its own readings",
        f"{_swatch(palette.AUTOPILOT, 0.6)}<b>See-through: the autopilot</b>, its own estimate",
    ]
    if has_position:
        rows.append(f"{_swatch(palette.DIFFERENCE, 1.0, line)}The distance between them; grid squares {cell:g} m")
    else:
        rows.append("This log has no position: only the attitudes are compared.")
    lines = "".join(f"<div>{row}</div>" for row in rows)
    return (
        f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.55"><div>{who}, vehicle '
        f"{escape(str(vehicle))}, boot {flight.boot}, {flight.duration:.0f} s</div>{lines}</div>"
    )


def _numbers(moment: Moment, now: float, has_position: bool) -> str:
    rows = [
        ("Time", f"{now:.1f} s", f"{moment.since_anchor_s:.1f} s since anchor"),
        ("Attitude error", f"{moment.tilt_deg:.2f}° tilt", f"{moment.heading_deg:+.2f}° heading"),
    ]
    if has_position:
        rows.append(("Velocity error", f"{moment.velocity_mps:.2f} m/s", ""))
        rows.append(("Position error", f"{moment.position_m:.2f} m", ""))
    cells = "".join(
        f'<tr><td style="opacity:0.7">{name}</td><td style="text-align:right;font-weight:600">{first}</td>'
        f'<td style="text-align:right">{second}</td></tr>'
        for name, first, second in rows
    )
    return (
        '<div style="padding:0.2em 1em"><table style="width:100%;font-size:0.88em;'
        f'font-variant-numeric:tabular-nums;border-spacing:0 0.15em">{cells}</table></div>'
    )
