"""The controls of the dead reckoning. Each changes its own part of what was requested last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import viser

from companion.comparison import Integration
from companion.model import Flight
from companion.present import AXES, palette
from companion.strapdown import METHODS
from companion.view.panels.controls import Controls, bounded, key_of, write
from companion.view.state.trajectory import NO_BIAS, Corrected, Offer, ReplayChoice

Change = Callable[[Callable[[ReplayChoice], ReplayChoice]], object]
"""Dead-reckons otherwise in one respect; in all others as was requested last, whether it is already shown or not."""
INTEGRATORS = {METHODS[name].title: name for name in reversed(tuple(METHODS))}
MIDDLES = {"Linear": "linear", "Cubic": "cubic"}
GRAVITIES: dict[str, str | float] = {"9.80665 (standard)": "standard", "Where it flew (WGS-84)": "normal"}
CORRECTIONS: dict[str, Corrected] = {"Uncorrected": "no", "Corrected by this flight's calibration": "flight"}
MOST_SEGMENTS = 64
MOST_OTHERS = 6
GYRO_RANGE, ACCEL_RANGE = 20.0, 0.5  # mrad/s and m/s², either way
T = TypeVar("T")
# With a word joiner: a narrow label breaks before the unit, not in it.
GYRO_UNIT, ACCEL_UNIT = "mrad/\u2060s", "m/\u2060s²"
BESIDE = f'<div style="padding:0 1em;font-size:0.8em;opacity:{palette.QUIET}">Also shown, uncorrected:</div>'


def on_choice(
    controls: Controls, change: Change, handle: Any, part: Callable[[ReplayChoice, Any], ReplayChoice]
) -> None:
    """Change a part of the choice to what a control says: anything, so that names are looked up, numbers bounded."""
    controls.on_change(handle, lambda value: change(lambda choice: part(choice, value)))


def integration_controls(controls: Controls, how: Integration, change: Change) -> tuple[Any, Any]:
    """The lists of integrators and of interpolations."""
    add = controls.gui.add_dropdown
    method = add("Integrator", tuple(INTEGRATORS), initial_value=key_of(INTEGRATORS, how.method))
    middle = add(
        "Interpolation",
        tuple(MIDDLES),
        initial_value=key_of(MIDDLES, how.middle),
        hint="How the readings are interpolated between two samples",
    )
    on_choice(controls, change, method, lambda c, name: _how(c, method=_named(INTEGRATORS, name, c.how.method)))
    on_choice(controls, change, middle, lambda c, name: _how(c, middle=_named(MIDDLES, name, c.how.middle)))
    return method, middle


class DeadReckoningControls:
    """Those of a replay. Built once; `load` fits them to a flight. Only the view thread may call it."""

    def __init__(
        self, controls: Controls, offer: Offer, gravity: str | float, change: Change, now: Callable[[], float]
    ) -> None:
        """gravity: of the first choice, which stays in the list; now: the instant shown, s, boot clock."""
        gui, on = controls.gui, partial(on_choice, controls, change)
        self._gravities = GRAVITIES if gravity in GRAVITIES.values() else GRAVITIES | {f"{gravity:g}": gravity}
        self._corrections = dict(CORRECTIONS)
        if offer.correction_file is not None:
            self._corrections[f"Corrected by {offer.correction_file}"] = "file"
        self._horizons = {f"{h:g} s": h for h in offer.horizons_s}
        with gui.add_folder("Dead reckoning", expand_by_default=False):
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
            self._method, self._middle = integration_controls(controls, Integration(), change)
            self._segments = gui.add_number(
                "Segments", 1, min=1, max=MOST_SEGMENTS, step=1, hint="Integration steps between two samples"
            )
            self._gravity = gui.add_dropdown("Gravity, m/s²", tuple(self._gravities))
            self._anchored = gui.add_checkbox(
                "Re-anchor", True, hint="Restart from the autopilot's state at this interval; off: run free"
            )
            self._period = gui.add_number("every, s", 10.0, min=0.5, max=3600.0, step=0.5)
            self._start = gui.add_number("from, s", 0.0, min=0.0, step=0.1, hint="Seconds since the vehicle's boot")
            here = gui.add_button("Start from the instant shown", icon=viser.Icon.ANCHOR)
        with gui.add_folder("Subtract a bias from the IMU", expand_by_default=False):
            self._gyro, self._accel = (
                [gui.add_slider(f"{name} {axis}, {unit}", -most, most, step, 0.0) for axis in AXES]
                for name, unit, most, step in (
                    ("Gyro", GYRO_UNIT, GYRO_RANGE, 0.1),
                    ("Accel", ACCEL_UNIT, ACCEL_RANGE, 0.005),
                )
            )
            reset = gui.add_button("No bias", icon=viser.Icon.RESTORE)
        on(self._imu, self._with_imu)
        on(self._correction, lambda c, name: replace(c, correction=_named(self._corrections, name, c.correction)))
        on(self._horizon, lambda c, name: replace(c, horizon_s=_named(self._horizons, name, c.horizon_s)))
        on(self._segments, lambda c, count: _how(c, segments=int(bounded(count, 1, 1, MOST_SEGMENTS))))
        on(self._gravity, lambda c, name: replace(c, gravity=_named(self._gravities, name, c.gravity)))
        on(self._anchored, lambda c, anchored: replace(c, reanchor_s=_period(self._period.value) if anchored else None))
        on(self._period, lambda c, s: c if c.reanchor_s is None else replace(c, reanchor_s=_period(s)))
        on(self._start, self._with_start)
        for i, box in enumerate(self._others):
            on(box, partial(self._with_other, i))
        for i in range(len(AXES)):
            on(self._gyro[i], partial(_with_bias, "gyro_bias", i, 1e-3, GYRO_RANGE))
            on(self._accel[i], partial(_with_bias, "accel_bias", i, 1.0, ACCEL_RANGE))
        controls.on_click(here, lambda: change(lambda choice: replace(choice, start_s=now())))
        controls.on_click(reset, lambda: change(partial(replace, gyro_bias=NO_BIAS, accel_bias=NO_BIAS)))

    def load(self, flight: Flight, choice: ReplayChoice, start: float) -> None:
        """Show a choice. start: s, boot clock, where the dead reckoning begins. What is set here is no change."""
        self._flight = flight
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
        write(self._method, key_of(INTEGRATORS, choice.how.method))
        write(self._middle, key_of(MIDDLES, choice.how.middle))
        write(self._segments, choice.how.segments)
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

    def _with_imu(self, choice: ReplayChoice, name: object) -> ReplayChoice:
        if not isinstance(name, str) or name not in self._flight.imus:
            return choice
        return replace(choice, imu=name, others=tuple(other for other in choice.others if other != name))

    def _with_other(self, i: int, choice: ReplayChoice, shown: object) -> ReplayChoice:
        if i >= len(self._names) or self._names[i] == choice.imu:
            return choice
        others = {*choice.others} - {self._names[i]} | ({self._names[i]} if shown is True else set())
        return replace(choice, others=tuple(name for name in self._names if name in others))

    def _with_start(self, choice: ReplayChoice, seconds: object) -> ReplayChoice:
        begin = self._flight.start
        return replace(choice, start_s=bounded(seconds, begin, begin, begin + self._flight.duration))


def _named(options: Mapping[str, T], name: object, before: T) -> T:
    return options.get(name, before) if isinstance(name, str) else before


def _how(choice: ReplayChoice, **changes: Any) -> ReplayChoice:
    return replace(choice, how=replace(choice.how, **changes))


def _period(seconds: object) -> float:
    return bounded(seconds, 0.5, 10.0, 3600.0)


def _with_bias(part: str, i: int, unit: float, most: float, choice: ReplayChoice, value: object) -> ReplayChoice:
    """With another bias of one axis. part: of the choice; unit: of the slider."""
    bias = list(getattr(choice, part))
    bias[i] = unit * bounded(value, -most, 0.0, most)
    changes: dict[str, Any] = {part: tuple(bias)}
    return replace(choice, **changes)
