"""`companion noise LOG`: the noise of each IMU, at rest and in flight."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from companion.app import files
from companion.app.examination import noise_of
from companion.app.sensors import imu_model_text
from companion.app.settings import Settings
from companion.cli import options, tables
from companion.comparison import FlightNoise, ImuNoise, RestNoise
from companion.documents import noise_document
from companion.export import kalibr_text
from companion.model import DataError, Flight, InputError
from companion.noise import Sampling, folded_gain, folded_onto
from companion.present import SENSORS, capitalised, density, fixed, interval

_VIBRATION = {"gyro": ("°/s", float(np.degrees(1.0))), "accel": ("m/s²", 1.0)}
"""Unit of a vibration, and the factor to it."""

_TEXTS = {".yaml": kalibr_text, ".yml": kalibr_text, ".toml": imu_model_text}
_MOST_PEAKS = 4


def noise_options(parser: options.Parser) -> None:
    """The command's options."""
    options.add_log(parser, *options.FLIGHT)
    parser.add_argument("--imu", metavar="NAME", help="this IMU message alone (default: every one)")
    options.add(parser, "--imu-model", "--json")
    options.add_output(
        parser,
        "PATH",
        "write the noise of --imu, else of the default IMU: FILE.yaml for Kalibr, FILE.toml for --imu-model, or a "
        "folder for both",
    )


def run_noise(arguments: argparse.Namespace) -> int:
    """Print the noise; write it where requested."""
    path = Path(arguments.output) if arguments.output else None
    if path is not None:
        _check(path, force=arguments.force)
    settings, recording, flight = options.one_flight(arguments)
    names = [flight.imu(arguments.imu).source] if arguments.imu else list(flight.imus)
    main = flight.imu(arguments.imu).source
    noises, refused = _all(flight, names, settings, arguments.imu_model)
    if not noises:
        raise DataError(refused.get(main) or "; ".join(refused.values()))
    tables.show(arguments, _lines(noises, refused), lambda: noise_document(recording.source, flight, noises))
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
    if path.suffix in _TEXTS:
        files.check(path, force=force)
    elif path.suffix:
        raise InputError(
            f"cannot write {path}: the name has to end in .yaml (Kalibr), .toml (--imu-model) or be a folder."
        )
    else:
        files.check_folder(path, force=force)


def _write(path: Path, noise: ImuNoise, origin: str) -> None:
    if path.suffix in _TEXTS:
        files.write(path, _TEXTS[path.suffix](noise, origin))
    else:
        with files.filling(path) as folder:
            for suffix in (".yaml", ".toml"):
                (folder / f"imu{suffix}").write_text(_TEXTS[suffix](noise, origin), "utf-8", errors="replace")
    options.say(f"written: {path} ({noise.imu})")


def _lines(noises: list[ImuNoise], refused: dict[str, str]) -> Iterator[str | Table]:
    for i, noise in enumerate(noises):
        yield "\n" * (i > 0) + f"[bold]{escape(noise.imu)}[/], {noise.rate_hz:.1f} Hz"
        yield from _head(noise)
        for rest in noise.rests:
            yield f"\nAt rest, {rest.start_s:.1f}-{rest.end_s:.1f} s: Allan deviation, 95 %"
            yield _at_rest(rest)
        if noise.flight is not None:
            yield from _in_flight(noise, noise.flight)
        yield from (f"Note: {escape(note)}" for note in noise.notes)
    for name, why in refused.items():
        yield f"\n[bold]{escape(name)}[/]: {escape(why)}"


def _head(noise: ImuNoise) -> Iterator[str]:
    sheet = noise.imu_spec
    yield f"IMU noise model: {escape(sheet.name)} ({escape(sheet.reason)})"
    if noise.sampling == noise.accel_sampling:
        yield from _sampled(noise.sampling, noise.rate_hz)
        return
    for sensor, sampling in zip(SENSORS, (noise.sampling, noise.accel_sampling), strict=True):
        yield from (f"{capitalised(sensor.name)}: {line}" for line in _sampled(sampling, noise.rate_hz))


def _sampled(sampling: Sampling, rate_hz: float) -> Iterator[str]:
    source = {"log": "by the log", "spectrum": "by its spectrum at rest", "assumed": "assumed"}[sampling.source]
    if sampling.confirmed is not None:
        source += ", confirmed by its spectrum" if sampling.confirmed else ", not confirmed by its spectrum"
    if sampling.kind == "averaged":
        before = f", after a low-pass of {sampling.corner_hz:.0f} Hz (spectrum)" if sampling.corner_hz else ""
        yield f"Sampling: mean of {1e3 * (sampling.interval_s or 0.0):.1f} ms ({source}){before}"
    elif sampling.corner_hz:
        share = 1.0 - 1.0 / float(folded_gain(np.zeros(1), rate_hz, sampling)[0])
        yield f"Sampling: after a low-pass of {sampling.corner_hz:.0f} Hz ({source})"
        yield f"Aliasing: {100.0 * share:.0f} % of the white noise is folded from above {rate_hz / 2:.1f} Hz"
    else:
        seen = sampling.source == "spectrum"
        yield "Sampling: " + (f"no low-pass ({source})" if seen else "assumed unfiltered (not stated in the log)")
        yield f"Aliasing: whatever shakes faster than {rate_hz / 2:.1f} Hz is folded in"


def _at_rest(rest: RestNoise) -> Table:
    shown = tables.table("", "", "N /√Hz", "B", "K /√s", left=2)
    for sensor in SENSORS:
        for name, axis in zip("xyz", getattr(rest, f"{sensor.key}_axes"), strict=True):
            parts = (getattr(axis, part, None) for part in ("white", "instability", "walk"))
            shown.add_row(f"{sensor.key} {name}", sensor.unit, *(interval(one, sensor.factor) for one in parts))
    return shown


def _in_flight(noise: ImuNoise, flight: FlightNoise) -> Iterator[str | Table]:
    if flight.gyro is None or flight.accel is None:
        return
    low, high = flight.gyro.band_hz
    yield f"\nIn flight, {flight.duration_s:.0f} s: white noise, read at {low:.0f}-{high:.0f} Hz"
    shown = tables.table("", "", "N /√Hz", "data sheet", "times", left=2)
    for sensor in SENSORS:
        white, sheet = getattr(flight, sensor.key), getattr(noise.imu_spec, sensor.key).noise_density
        for i, name in enumerate("xyz"):
            stated, ratio = fixed(sheet * sensor.factor), f"{white.sampled[i] / sheet:.1f}"
            shown.add_row(f"{sensor.key} {name}", sensor.unit, density(white, i, sensor.factor), stated, ratio)
    yield shown
    for sensor in SENSORS:
        unit, factor = _VIBRATION[sensor.key]
        peaks = sorted(getattr(flight, f"{sensor.key}_peaks"), key=lambda peak: -peak.amplitude)
        for peak in peaks[:_MOST_PEAKS]:
            other = " or ".join(f"{f:.0f}" for f in folded_onto(peak.frequency_hz, noise.rate_hz, 2))
            size = fixed(peak.amplitude * factor)
            yield f"Peak: {sensor.name} {'xyz'[peak.axis]} {size} {unit} at {peak.frequency_hz:.1f} Hz (or {other})"
    if not (flight.gyro_peaks or flight.accel_peaks):
        yield "Peaks: none"
