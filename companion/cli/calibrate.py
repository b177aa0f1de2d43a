"""`companion calibrate LOG`: the IMU errors that best explain a flight, as a correction for others."""

from __future__ import annotations

import argparse

from companion.app import files
from companion.app.correction import correction_text
from companion.app.examination import assess_imu
from companion.cli import options, parsers, tables
from companion.model import DataError


def add_options(parser: parsers.Parser) -> None:
    """The command's options."""
    parsers.add_log(parser, *parsers.FLIGHT, *parsers.INTEGRATION, "--imu-model")
    force = "replace FILE when it is there already, and write it when the flight is no good for it"
    parsers.add_output(parser, "FILE", "write the correction for analyze --correction", force)


def run(arguments: argparse.Namespace) -> int:
    """Print the calibration; write it where requested."""
    path = options.output(arguments)
    settings, _, flight = options.one_flight(arguments)
    assessment = assess_imu(flight, settings, imu=arguments.imu, imu_model=arguments.imu_model)
    if assessment.calibration is None:
        raise DataError(f"no calibration: {assessment.verdict.summary}")
    calibrated = tables.calibration_lines(assessment)
    tables.console().lines(*tables.verdict_lines(assessment.verdict, most=3), "", *calibrated)
    if path is None:
        return 0
    if not arguments.force and (assessment.verdict.status == "insufficient_data" or assessment.made_worse):
        raise DataError(
            "not written: this flight does not determine the IMU's constant errors (see above). "
            "Write it all the same: --force"
        )
    files.write(path, correction_text(assessment.calibration, f"{arguments.log} ({assessment.drift.imu})"))
    options.say(f"written: {path}")
    return 0
