"""`companion noise LOG`: how noisy each IMU is, at rest and in flight."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich import box
from rich.markup import escape
from rich.table import Table

from companion.analysis import AxisNoise, FlightNoise, ImuNoise, RestNoise
from companion.app import destination
from companion.app.examination import noise_of
from companion.app.sensors import imu_model_text
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.documents import encode, noise_document
from companion.estimation import Coefficient, folded_gain, folded_onto
from companion.export import kalibr_text
from companion.model import STANDARD_GRAVITY, DataError, Flight, InputError
from companion.present import fixed

_SENSORS = (
    ("gyro", "gyro", 1e3 * float(np.degrees(1.0)), "mdps", "°/s", float(np.degrees(1.0))),
    ("accel", "accelerometer", 1e6 / STANDARD_GRAVITY, "µg", "m/s²", 1.0),
)
"""Attribute, name, factor to the unit of densities, that unit, unit of a vibration and the factor to it."""

_FILES = {".yaml": "kalibr", ".yml": "kalibr", ".toml": "model"}
_MOST_PEAKS = 4


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = options.add_command(
        commands,
        "noise",
        "IMU noise: Allan deviation at rest, spectra in flight",
        "How noisy the IMUs are: Allan deviation at rest, spectra and vibration in flight.",
        "companion noise flight.tlog -o imu.yaml",
    )
    options.add_flight_choice(parser)
    parser.add_argument("--imu", metavar="NAME", help="this IMU message alone (default: every one)")
    options.add_figures(parser)
    parser.add_argument("--json", action="store_true", help="the same as JSON on stdout (docs/json.md)")
    parser.add_argument(
        "-o",
        "--output",
        metavar="PATH",
        help="write the noise of --imu, else of the default IMU: FILE.yaml for Kalibr, FILE.toml for --imu-model, or "
        "a folder for both",
    )
    parser.add_argument("--force", action="store_true", help="replace what is there already")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the noise; write it where asked."""
    path = Path(arguments.output) if arguments.output else None
    if path is not None:
        _check(path, force=arguments.force)
    settings, recording, flight = options.one_flight(arguments)
    names = [flight.imu(arguments.imu).source] if arguments.imu else list(flight.imus)
    main = flight.imu(arguments.imu).source
    noises, refused = _all(flight, names, settings, arguments.imu_model)
    if not noises:
        raise DataError(refused.get(main) or "; ".join(refused.values()))
    if arguments.json:
        print(encode(noise_document(recording.source, flight, noises)))
    else:
        _print(noises, refused)
    if path is not None:
        _write(path, next((noise for noise in noises if noise.imu == main), noises[0]), Path(arguments.log).name)
    return 0


def _all(
    flight: Flight, names: list[str], settings: Settings, model: str | None
) -> tuple[list[ImuNoise], dict[str, str]]:
    """The noise of each IMU, and why there is none."""
    noises, refused = [], {}
    for name in names:
        try:
            noises.append(noise_of(flight, settings, imu=name, imu_model=model))
        except DataError as error:
            refused[name] = str(error)
    return noises, refused


def _check(path: Path, *, force: bool) -> None:
    if path.suffix in _FILES:
        destination.check(path, force=force)
    elif path.suffix:
        raise InputError(
            f"cannot write {path}: the name has to end in .yaml (Kalibr), .toml (--imu-model) or be a folder."
        )
    else:
        destination.check_folder(path, force=force)


def _write(path: Path, noise: ImuNoise, origin: str) -> None:
    texts = {"kalibr": kalibr_text, "model": imu_model_text}
    if (kind := _FILES.get(path.suffix)) is not None:
        with destination.replacing(path) as part:
            part.write_text(texts[kind](noise, origin), encoding="utf-8")
    else:
        with destination.filling(path) as folder:
            (folder / "imu.yaml").write_text(kalibr_text(noise, origin), encoding="utf-8")
            (folder / "imu.toml").write_text(imu_model_text(noise, origin), encoding="utf-8")
    options.say(f"written: {path} ({noise.imu})")


def _print(noises: list[ImuNoise], refused: dict[str, str]) -> None:
    console = tables.console()
    for i, noise in enumerate(noises):
        console.print("\n" * (i > 0) + f"[bold]{escape(noise.imu)}[/], {noise.rate_hz:.1f} Hz", highlight=False)
        for line in _head(noise):
            console.print(line, highlight=False)
        for rest in noise.rests:
            console.print(f"\nAt rest, {rest.start_s:.1f}-{rest.end_s:.1f} s: Allan deviation, 95 %", highlight=False)
            console.print(_rest_table(rest), no_wrap=True)
        if noise.flight is not None:
            for part in _flight_parts(noise, noise.flight):
                console.print(part, highlight=False)
        for note in noise.notes:
            console.print(f"Note: {escape(note)}", highlight=False)
    for name, why in refused.items():
        console.print(f"\n[bold]{escape(name)}[/]: {escape(why)}", highlight=False)


def _head(noise: ImuNoise) -> Iterator[str]:
    how, sheet = noise.sampling, noise.figures
    yield f"IMU noise model: {escape(sheet.name)} ({escape(sheet.reason)})"
    told = {"log": "by the log", "spectrum": "by its spectrum at rest", "assumed": "assumed"}[how.source]
    if how.confirmed is not None:
        told += ", confirmed by its spectrum" if how.confirmed else ", not confirmed by its spectrum"
    if how.kind == "averaged":
        before = f", after a low-pass of {how.corner_hz:.0f} Hz (spectrum)" if how.corner_hz else ""
        yield f"Sampling: mean of {1e3 * (how.interval_s or 0.0):.1f} ms ({told}){before}"
    elif how.corner_hz:
        share = 1.0 - 1.0 / float(folded_gain(np.zeros(1), noise.rate_hz, how)[0])
        yield f"Sampling: after a low-pass of {how.corner_hz:.0f} Hz ({told})"
        yield f"Aliasing: {share:.0%} of the white noise is folded from above {noise.rate_hz / 2:.1f} Hz"
    else:
        seen = how.source == "spectrum"
        yield "Sampling: " + (f"no low-pass ({told})" if seen else "assumed unfiltered (not stated in the log)")
        yield f"Aliasing: whatever shakes faster than {noise.rate_hz / 2:.1f} Hz is folded in"


def _rest_table(rest: RestNoise) -> Table:
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for heading in ("", "", "N /√Hz", "B", "K /√s"):
        shown.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for key, _, factor, unit, _, _ in _SENSORS:
        for name, axis in zip("xyz", getattr(rest, f"{key}_axes"), strict=True):
            cells = _cells(axis, factor) if axis is not None else ["-"] * 3
            shown.add_row(f"{key} {name}", unit, *cells)
    return shown


def _cells(axis: AxisNoise, factor: float) -> list[str]:
    return [
        "-" if figure is None else _coefficient(figure, factor) for figure in (axis.white, axis.instability, axis.walk)
    ]


def _coefficient(coefficient: Coefficient, factor: float) -> str:
    """4.2 (4.1-4.3), or < 5 for a bound."""
    if coefficient.value is None:
        return f"< {fixed(coefficient.high * factor)}"
    return f"{fixed(coefficient.value * factor)} ({fixed(coefficient.low * factor)}-{fixed(coefficient.high * factor)})"


def _flight_parts(noise: ImuNoise, flight: FlightNoise) -> Iterator[str | Table]:
    if flight.gyro is None or flight.accel is None:
        return
    low, high = flight.gyro.band_hz
    yield f"\nIn flight, {flight.duration_s:.0f} s: white noise, read at {low:.0f}-{high:.0f} Hz"
    shown = Table(box=box.SIMPLE_HEAD, padding=(0, 0, 0, 1), show_edge=False)
    for heading in ("", "", "N /√Hz", "data sheet", "times"):
        shown.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for key, _, factor, unit, _, _ in _SENSORS:
        white, sheet = getattr(flight, key), getattr(noise.figures, key).noise_density
        for i, name in enumerate("xyz"):
            value = f"{fixed(white.sampled[i] * factor)} ± {fixed(white.sigma[i] * factor)}"
            value = f"< {fixed(white.sampled[i] * factor)}" if white.hidden[i] else value
            ratio = f"{white.sampled[i] / sheet:.1f}"
            shown.add_row(f"{key} {name}", unit, value, fixed(sheet * factor), ratio)
    yield shown
    for key, title, _, _, unit, factor in _SENSORS:
        lines = sorted(getattr(flight, f"{key}_peaks"), key=lambda peak: -peak.amplitude)[:_MOST_PEAKS]
        for peak in lines:
            other = " or ".join(f"{f:.0f}" for f in folded_onto(peak.frequency_hz, noise.rate_hz, 2))
            size = fixed(peak.amplitude * factor)
            yield f"Peak: {title} {'xyz'[peak.axis]} {size} {unit} at {peak.frequency_hz:.1f} Hz (or {other})"
    if not (flight.gyro_peaks or flight.accel_peaks):
        yield "Peaks: none"
