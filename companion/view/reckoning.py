"""The controls of how the IMU is reckoned. Every change becomes one choice for the view thread."""

from __future__ import annotations

from dataclasses import replace

import viser

from companion.model import Flight
from companion.view import events, palette
from companion.view.choice import NO_BIAS, Corrected, Offer, ReplayChoice
from companion.view.controls import bounded, key_of, listen, write

METHODS = {"RK4 (most exact)": "rk4", "Midpoint": "midpoint", "Euler (simplest)": "euler"}
MIDDLES = {"Linear": "linear", "Cubic": "cubic"}
JOINED = "How the readings are interpolated between two samples"
GRAVITIES: dict[str, str | float] = {"9.80665 (standard)": "standard", "Where it flew (WGS-84)": "normal"}
CORRECTIONS: dict[str, Corrected] = {"Uncorrected": "no", "Corrected by this flight's calibration": "flight"}
MOST_SEGMENTS = 64
MOST_OTHERS = 6
GYRO_RANGE, ACCEL_RANGE = 20.0, 0.5  # mrad/s and m/s², either way
AXES = ("forward", "right", "down")
GYRO_UNIT, ACCEL_UNIT = (
    "mrad/\u2060s",
    "m/\u2060s²",
)  # with a word joiner: a narrow label breaks before the unit, not in it
BESIDE = f'<div style="padding:0 1em;font-size:0.8em;opacity:{palette.QUIET}">Also shown, uncorrected:</div>'


class ReckoningControls:
    """Built once; `load` fits them to a flight. Only the view thread may call it."""

    def __init__(self, gui: viser.GuiApi, flight: Flight, offer: Offer, post: events.Post) -> None:
        self._flight, self._post = flight, post
        self._gravities, self._corrections = GRAVITIES, dict(CORRECTIONS)
        self._choice = ReplayChoice()
        if offer.correction_file is not None:
            self._corrections[f"Corrected by {offer.correction_file}"] = "file"
        self._horizons = {f"{h:g} s": h for h in offer.horizons_s}
        with gui.add_folder("Dead reckoning"):
            self._imu = gui.add_dropdown("IMU", ("none",))
            self._beside = gui.add_html(BESIDE, visible=False)
            self._others = [
                gui.add_checkbox("", False, visible=False, hint="Its trajectory too, uncorrected")
                for _ in range(MOST_OTHERS)
            ]
            self._names: list[str] = []
            self._correction = gui.add_dropdown(
                "Readings", tuple(self._corrections), hint="Remove the errors that the calibration finds"
            )
            self._horizon = gui.add_dropdown(
                "Horizon", tuple(self._horizons), hint="Length of the windows of drift table and charts"
            )
            self._method = gui.add_dropdown("Integrator", tuple(METHODS))
            self._middle = gui.add_dropdown("Interpolation", tuple(MIDDLES), hint=JOINED)
            self._segments = gui.add_number(
                "Segments", 1, min=1, max=MOST_SEGMENTS, step=1, hint="Integration steps between two samples"
            )
            self._gravity = gui.add_dropdown("Gravity, m/s²", tuple(GRAVITIES))
            self._anchored = gui.add_checkbox(
                "Re-anchor", True, hint="Restart from the autopilot's state at this interval; off: run free"
            )
            self._period = gui.add_number("every, s", 10.0, min=0.5, max=3600.0, step=0.5)
            self._start = gui.add_number("from, s", 0.0, min=0.0, step=0.1, hint="Seconds since the vehicle's boot")
            self._here = gui.add_button("Start from the instant shown", icon=viser.Icon.ANCHOR)
        with gui.add_folder("Subtract a bias from the IMU", expand_by_default=False):
            self._gyro = [
                gui.add_slider(f"Gyro {axis}, {GYRO_UNIT}", -GYRO_RANGE, GYRO_RANGE, 0.1, 0.0) for axis in AXES
            ]
            self._accel = [
                gui.add_slider(f"Accel {axis}, {ACCEL_UNIT}", -ACCEL_RANGE, ACCEL_RANGE, 0.005, 0.0) for axis in AXES
            ]
            self._reset = gui.add_button("No bias", icon=viser.Icon.RESTORE)
        self._listen()

    def load(self, flight: Flight, choice: ReplayChoice, start: float) -> None:
        """Show a choice. start: s, boot clock, where the reckoning begins. Values set here come back as no events."""
        self._flight, self._choice = flight, choice
        self._imu.options = tuple(flight.imus) or ("none",)
        if choice.imu is not None and choice.imu in flight.imus:
            write(self._imu, choice.imu)
        self._names = [name for name, track in flight.imus.items() if len(track) > 1 and name != choice.imu]
        self._beside.visible = bool(self._names)
        for i, box in enumerate(self._others):
            box.visible = i < len(self._names)
            if box.visible:
                box.label = self._names[i]
                write(box, self._names[i] in choice.others)
        write(self._correction, key_of(self._corrections, choice.correction))
        write(self._horizon, next((k for k, h in self._horizons.items() if h == choice.horizon_s), self._horizon.value))
        write(self._method, key_of(METHODS, choice.how.method))
        write(self._middle, key_of(MIDDLES, choice.how.middle))
        write(self._segments, choice.how.segments)
        if choice.gravity not in self._gravities.values():
            self._gravities = GRAVITIES | {f"{choice.gravity:g}": choice.gravity}
            self._gravity.options = tuple(self._gravities)
        write(self._gravity, key_of(self._gravities, choice.gravity))
        write(self._anchored, choice.reanchor_s is not None)
        self._period.visible = choice.reanchor_s is not None
        if choice.reanchor_s is not None:
            write(self._period, choice.reanchor_s)
        write(self._start, round(start if choice.start_s is None else choice.start_s, 3))
        for slider, rate in zip(self._gyro, choice.gyro_bias, strict=True):
            write(slider, bounded(1e3 * rate, -GYRO_RANGE, 0.0, GYRO_RANGE))
        for slider, force in zip(self._accel, choice.accel_bias, strict=True):
            write(slider, bounded(force, -ACCEL_RANGE, 0.0, ACCEL_RANGE))

    def _listen(self) -> None:
        post = self._post
        chosen = (self._imu, self._correction, self._horizon, self._method, self._middle, self._segments, self._gravity)
        where = (self._anchored, self._period, self._start)
        for handle in (*chosen, *where, *self._others, *self._gyro, *self._accel):
            listen(handle, post, lambda: events.Choose(self._read()))

        @self._here.on_click
        async def _(_: object) -> None:
            post(events.StartHere())

        @self._reset.on_click
        async def _(_: object) -> None:
            post(events.Choose(replace(self._read(), gyro_bias=NO_BIAS, accel_bias=NO_BIAS)))

    def _read(self) -> ReplayChoice:
        """What the controls say. A browser may send anything: names are looked up, numbers kept in bounds."""
        flight, before = self._flight, self._choice
        gyro = [1e-3 * bounded(slider.value, -GYRO_RANGE, 0.0, GYRO_RANGE) for slider in self._gyro]
        accel = [bounded(slider.value, -ACCEL_RANGE, 0.0, ACCEL_RANGE) for slider in self._accel]
        imu = self._imu.value if self._imu.value in flight.imus else before.imu
        boxes = zip(self._names, self._others, strict=False)
        return replace(
            before,
            imu=imu,
            others=tuple(name for name, box in boxes if box.value is True and name != imu),
            how=replace(
                before.how,
                method=METHODS.get(self._method.value, before.how.method),
                middle=MIDDLES.get(self._middle.value, before.how.middle),
                segments=int(bounded(self._segments.value, 1, 1, MOST_SEGMENTS)),
            ),
            gravity=self._gravities.get(self._gravity.value, before.gravity),
            reanchor_s=bounded(self._period.value, 0.5, 10.0, 3600.0) if self._anchored.value else None,
            start_s=bounded(self._start.value, flight.start, flight.start, flight.start + flight.duration),
            horizon_s=self._horizons.get(self._horizon.value, before.horizon_s),
            correction=self._corrections.get(self._correction.value, before.correction),
            gyro_bias=(gyro[0], gyro[1], gyro[2]),
            accel_bias=(accel[0], accel[1], accel[2]),
        )
