"""The commands: what each does, in one line of a list and in a sentence or two, and an example."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Command:
    """A command: a module of this package of the same name, loaded when it is needed."""

    brief: str
    summary: str
    example: str
    is_helper: bool = False  # one that serves other programs: the list has its name alone


COMMANDS = {
    "info": Command(
        "What a log has: vehicles, sensors, messages, rates, gaps",
        "What is in a log: vehicles, boots, sensors, messages, rates, gaps.",
        "companion info flight.tlog",
    ),
    "analyze": Command(
        "The verdict: do IMU and autopilot agree, or which is wrong?",
        "Do IMU and autopilot agree? How far the IMU drifts by itself, how far it should, and who is wrong.",
        "companion analyze flight.tlog --imu RAW_IMU --horizons 1,5,10",
    ),
    "report": Command(
        "One HTML file with verdict, charts and 3D replay",
        "One HTML file with the verdict, the charts and the 3D playback of a flight: to mail, to print, to keep.",
        "companion report flight.tlog -o report.html",
    ),
    "calibrate": Command(
        "The IMU errors that best explain a flight, each with its σ",
        "The IMU's biases, scale, axes, mounting, lever arm and lag that best explain a flight, with their errors.",
        "companion calibrate flight.tlog -o imu.toml",
    ),
    "smooth": Command(
        "Best estimate of the trajectory from all sensors, without the EKF",
        "Where it really was: the best estimate of the trajectory from all sensors, independent of the EKF.",
        "companion smooth flight.tlog -o best.tum",
    ),
    "lanes": Command(
        "Which EKF lane should have been flown, and was each switch right?",
        "Every lane of the estimator against the best estimate: which should have been flown, each switch judged.",
        "companion lanes flight.bin",
    ),
    "incident": Command(
        "The last seconds before it went wrong, with the probable causes",
        "The seconds around a crash, loss of control, failsafe, fault or lane switch, as a page to post.",
        "companion incident flight.bin -o incident.html",
    ),
    "preflight": Command(
        "Before take-off: is each sensor fit to fly? Go or no-go by line",
        "A vehicle that stands for 20 to 60 s, in a log or on a link: each sensor against its limit, go or no-go.",
        "companion preflight flight.bin, companion preflight udpin:0.0.0.0:14550",
    ),
    "noise": Command(
        "IMU noise: Allan deviation at rest, spectra in flight",
        "How noisy the IMUs are: Allan deviation at rest, spectra and vibration in flight.",
        "companion noise flight.tlog -o imu.yaml",
    ),
    "compare": Command(
        "Two flights side by side: which drifts more?",
        "Two flights, or one before and after a change, side by side: which drifts more, and is that significant?",
        "companion compare flight.tlog --correction-b imu.toml",
    ),
    "view": Command(
        "A flight in the browser, in 3D: a log, or a live link",
        "See the flight twice in the browser: as the autopilot had it and as the IMU alone would have it. "
        "A log is replayed; a link is shown live, and recorded.",
        "companion view flight.tlog --open, companion view udpin:0.0.0.0:14550",
    ),
    "export": Command(
        "A flight for evo, Foxglove, maps, spreadsheets, notebooks",
        "A flight for other tools: evo, Foxglove, spreadsheets, notebooks.",
        "companion export flight.tlog --format mcap -o flight.mcap",
    ),
    "series": Command(
        "Values of a flight over time, as CSV or JSON",
        "Values of a flight over time, as CSV or JSON, evenly thinned out; without a table which ones there are.",
        "companion series flight.tlog attitude --from 70 --to 80 --json",
        is_helper=True,
    ),
    "fleet": Command(
        "Every flight of many logs: tables and one page",
        "Every flight of many logs, on all processors or a Dask cluster: tables in Parquet, and a page.",
        "companion fleet logs/ -o results",
    ),
    "check": Command(
        "Pass or fail for CI: JUnit XML, exit code, a baseline",
        "Every flight of some logs as a test that passes or fails, for continuous integration: exit code, JUnit XML, "
        "and whether drift or detectable faults are worse than a baseline's.",
        "companion check logs/ --junit companion.xml --baseline hover.json",
    ),
    "record": Command(
        "Record a link into a .tlog, at the rates that are needed",
        "Attach to a vehicle or simulator, ask for its IMU, and record a telemetry log until Ctrl-C.",
        "companion record udpin:0.0.0.0:14550 -o flight.tlog",
    ),
    "watch": Command(
        "Judge a vehicle while it flies: one JSON line a second",
        "Judge a vehicle while it flies, without a page: one JSON line a second on stdout, and a recording.",
        "companion watch /dev/ttyACM0 --fail-on suspect | jq .status",
    ),
    "watch-folder": Command(
        "The verdict on each log that comes into a folder",
        "The verdict on each log that comes into a folder, of a ground station or a card, as soon as it is whole.",
        "companion watch-folder ~/Documents/QGroundControl",
        is_helper=True,
    ),
    "simulate": Command(
        "A simulated vehicle, on a link or into a .tlog",
        "Fly a simulated vehicle whose truth is known, on a link or into a telemetry log.",
        "companion simulate udpout:127.0.0.1:14550 --duration 120",
        is_helper=True,
    ),
    "replay": Command(
        "Send a recorded log to a link, for testing clients",
        "Send a telemetry log's packets to a link at their own pace: for testing clients, never for a vehicle.",
        "companion replay flight.tlog udpout:127.0.0.1:14550",
        is_helper=True,
    ),
    "mcp": Command(
        "Let an assistant ask about the logs in a folder (MCP)",
        "An MCP server on stdin and stdout: assistants ask about the logs in a folder, and get the documented JSON.",
        "companion mcp ~/logs",
        is_helper=True,
    ),
    "doctor": Command(
        "What this installation lacks, and how to install it",
        "What this installation has and lacks: libraries, extras, demo flight, serial ports, folders, terminal.",
        "companion doctor",
        is_helper=True,
    ),
    "completion": Command(
        "Completion for bash, zsh or tcsh",
        "Print a script with which the shell completes commands, options and files.",
        "companion completion bash > ~/.local/share/bash-completion/completions/companion",
        is_helper=True,
    ),
}
"""Name → command, in the order in which they are listed."""
