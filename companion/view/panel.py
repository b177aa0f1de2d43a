"""What can be chosen and read beside the picture. Every choice becomes an event for the view thread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape

import viser

from companion.tracks import Flight
from companion.view import events, palette
from companion.view.choice import NO_BIAS, ReplayChoice
from companion.view.controls import bounded, listen, write
from companion.view.moment import Moment
from companion.view.palette import Rgb
from companion.view.picture import PictureControls

METHODS = {"RK4 (most exact)": "rk4", "Midpoint": "midpoint", "Euler (simplest)": "euler"}
MIDDLES = {"Straight lines (linear)": "linear", "Curves (cubic)": "cubic"}
GRAVITIES: dict[str, str | float] = {"9.80665 (standard)": "standard", "Where it flew (WGS-84)": "normal"}
TRAILS = {
    "Path so far": events.SetTrail(None),
    "Last 10 s": events.SetTrail(10.0),
    "Last 30 s": events.SetTrail(30.0),
    "Whole path": events.SetTrail(None, ahead=True),
}
MOST_SEGMENTS = 64
GYRO_RANGE, ACCEL_RANGE = 20.0, 0.5  # mrad/s and m/s², either way
AXES = ("forward", "right", "down")


class Panel:
    """The controls. Built once; `load` fits them to a flight, `show` writes the instant into them."""

    def __init__(self, gui: viser.GuiApi, flights: Sequence[Flight], post: events.Post) -> None:
        self._post = post
        self._flight = flights[0]
        self._gravities = GRAVITIES
        self._legend = gui.add_html("")
        self._numbers = gui.add_html("")
        self.playing = gui.add_folder("Playing")  # filled by the timeline
        with gui.add_folder("Reckoning from the IMU"):
            names = tuple(f"{i + 1}: {_title(f)}" for i, f in enumerate(flights))
            self._pick = gui.add_dropdown("Flight", names, visible=len(flights) > 1)
            self._imu = gui.add_dropdown("IMU", ("none",))
            self._method = gui.add_dropdown("Integrator", tuple(METHODS))
            self._middle = gui.add_dropdown(
                "Joined by", tuple(MIDDLES), hint="How the readings are taken to run from one sample to the next"
            )
            self._segments = gui.add_number(
                "Segments", 1, min=1, max=MOST_SEGMENTS, step=1, hint="Steps of the integrator between two samples"
            )
            self._gravity = gui.add_dropdown("Gravity, m/s²", tuple(GRAVITIES))
            self._anchored = gui.add_checkbox(
                "Re-anchor", True, hint="Start again from the autopilot's state, over and over; off: run free"
            )
            self._period = gui.add_number("every, s", 10.0, min=0.5, max=3600.0, step=0.5)
            self._start = gui.add_number("from, s", 0.0, min=0.0, step=0.1, hint="Seconds since the vehicle's boot")
            self._here = gui.add_button("Start from the instant shown", icon=viser.Icon.ANCHOR)
            self._status = gui.add_html("")
        with gui.add_folder("Take a bias off the IMU", expand_by_default=False):
            self._gyro = [gui.add_slider(f"Gyro {axis}, mrad/s", -GYRO_RANGE, GYRO_RANGE, 0.1, 0.0) for axis in AXES]
            self._accel = [
                gui.add_slider(f"Accel {axis}, m/s²", -ACCEL_RANGE, ACCEL_RANGE, 0.005, 0.0) for axis in AXES
            ]
            self._reset = gui.add_button("No bias", icon=viser.Icon.RESTORE)
        self._picture = PictureControls(gui, TRAILS, post)
        with gui.add_folder("Save", expand_by_default=False):
            self._save_picture = gui.add_button("This picture (PNG)", icon=viser.Icon.CAMERA)
            self._save_page = gui.add_button("The 3D replay (HTML)", icon=viser.Icon.FILE_EXPORT)
        self._listen()

    @property
    def picture(self) -> viser.GuiFolderHandle:
        """The folder in which each browser finds its own camera."""
        return self._picture.folder

    def load(self, flight: Flight, choice: ReplayChoice, start: float, has_position: bool) -> None:
        """Fit the controls to what is shown now. `start`: s, boot clock, where the reckoning begins.

        Values set here come back as no events.
        """
        self._flight = flight
        self._legend.content = _legend(flight, has_position)
        self._imu.options = tuple(flight.imus) or ("none",)
        if choice.imu is not None and choice.imu in flight.imus:
            write(self._imu, choice.imu)
        write(self._method, _key(METHODS, choice.method))
        write(self._middle, _key(MIDDLES, choice.middle))
        write(self._segments, choice.segments)
        if choice.gravity not in self._gravities.values():
            self._gravities = GRAVITIES | {f"{choice.gravity:g}": choice.gravity}
            self._gravity.options = tuple(self._gravities)
        write(self._gravity, next(key for key, meaning in self._gravities.items() if meaning == choice.gravity))
        write(self._anchored, choice.reanchor_s is not None)
        self._period.visible = choice.reanchor_s is not None
        if choice.reanchor_s is not None:
            write(self._period, choice.reanchor_s)
        write(self._start, round(start if choice.start_s is None else choice.start_s, 3))
        for slider, rate in zip(self._gyro, choice.gyro_bias, strict=True):
            write(slider, bounded(1e3 * rate, -GYRO_RANGE, 0.0, GYRO_RANGE))
        for slider, force in zip(self._accel, choice.accel_bias, strict=True):
            write(slider, bounded(force, -ACCEL_RANGE, 0.0, ACCEL_RANGE))

    def show(self, moment: Moment, cell: float, has_position: bool) -> None:
        """Write the instant, and the side of the grid's squares (m), into the numbers."""
        self._numbers.content = _numbers(moment, moment.t - self._flight.start, cell, has_position)

    def status(self, text: str, *, trouble: bool = False) -> None:
        """Say what the reckoning is doing, or why it failed. `text` may hold anything."""
        colour = palette.css(palette.IMU) if trouble else "inherit"
        html = f'<div style="padding:0 1em 0.5em;font-size:0.8em;color:{colour}">{escape(text)}</div>' if text else ""
        if self._status.content != html:
            self._status.content = html

    def _listen(self) -> None:
        post = self._post
        listen(self._pick, post, lambda: events.PickFlight(int(self._pick.value.split(":")[0]) - 1))
        reckoning = (self._imu, self._method, self._middle, self._segments, self._gravity, self._anchored)
        for handle in (*reckoning, self._period, self._start, *self._gyro, *self._accel):
            listen(handle, post, lambda: events.Choose(self._choice()))

        @self._here.on_click
        async def _(_: object) -> None:
            post(events.StartHere())

        @self._reset.on_click
        async def _(_: object) -> None:
            post(events.Choose(replace(self._choice(), gyro_bias=NO_BIAS, accel_bias=NO_BIAS)))

        @self._save_picture.on_click
        async def _(click: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if click.client_id is not None:
                post(events.Save(click.client_id, "picture"))

        @self._save_page.on_click
        async def _(click: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            if click.client_id is not None:
                post(events.Save(click.client_id, "page"))

    def _choice(self) -> ReplayChoice:
        """What the controls say. A browser may send anything: names are looked up, numbers kept in bounds."""
        flight = self._flight
        gyro = [1e-3 * bounded(slider.value, -GYRO_RANGE, 0.0, GYRO_RANGE) for slider in self._gyro]
        accel = [bounded(slider.value, -ACCEL_RANGE, 0.0, ACCEL_RANGE) for slider in self._accel]
        return ReplayChoice(
            imu=self._imu.value if self._imu.value in flight.imus else None,
            method=METHODS.get(self._method.value, "rk4"),
            middle=MIDDLES.get(self._middle.value, "cubic"),
            reanchor_s=bounded(self._period.value, 0.5, 10.0, 3600.0) if self._anchored.value else None,
            start_s=bounded(self._start.value, flight.start, flight.start, flight.start + flight.duration),
            segments=int(bounded(self._segments.value, 1, 1, MOST_SEGMENTS)),
            gravity=self._gravities.get(self._gravity.value, "standard"),
            gyro_bias=(gyro[0], gyro[1], gyro[2]),
            accel_bias=(accel[0], accel[1], accel[2]),
        )


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


def _legend(flight: Flight, has_position: bool) -> str:
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
        rows.append(f"{_swatch(palette.DIFFERENCE, 1.0, line)}The distance between them")
    else:
        rows.append("This log has no position: only the attitudes are compared.")
    lines = "".join(f"<div>{row}</div>" for row in rows)
    return (
        f'<div style="padding:0.2em 1em;font-size:0.8em;line-height:1.55"><div>{who}, vehicle '
        f"{escape(str(vehicle))}, boot {flight.boot}, {flight.duration:.0f} s</div>{lines}</div>"
    )


def _numbers(moment: Moment, since_start: float, cell: float, has_position: bool) -> str:
    rows = [
        ("Since boot", f"{moment.t:.2f} s", f"{since_start:.1f} s into the log"),
        ("Since anchor", f"{moment.since_anchor_s:.1f} s", "" if moment.known else "autopilot silent here"),
        ("Attitude error", f"{moment.tilt_deg:.2f}° tilt", f"{moment.heading_deg:+.2f}° heading"),
    ]
    if has_position:
        rows.append(("Velocity error", f"{moment.velocity_mps:.2f} m/s", ""))
        rows.append(("Position error", f"{moment.position_m:.2f} m", f"grid squares {cell:g} m"))
    cells = "".join(
        f'<tr><td style="opacity:0.7">{name}</td><td style="text-align:right;font-weight:600">{first}</td>'
        f'<td style="text-align:right">{second}</td></tr>'
        for name, first, second in rows
    )
    return (
        '<div style="padding:0.2em 1em"><table style="width:100%;font-size:0.88em;'
        f'font-variant-numeric:tabular-nums;border-spacing:0 0.1em">{cells}</table></div>'
    )
