"""The paths of a flight as KML (OGC 2.3): Google Earth, QGIS, and every map that takes a file."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

from companion.analysis import Replay
from companion.estimation import BestEstimate
from companion.export.format import Format
from companion.export.paths import COLOURS, geodetic, paths, places
from companion.model import DataError, Flight

_NAMES = {"autopilot": "Autopilot (EKF)", "imu": "IMU alone", "best": "Best estimate"}


def write_kml(path: Path, flight: Flight, shown: Replay, best: BestEstimate | None = None) -> list[Path]:
    """A line for each path, heights above mean sea level.

    Raises DataError when the log has no position, or does not tell where on Earth it was.
    """
    lines = []
    for name, positions in paths(shown, best).items():
        if name == "best" and best is not None:
            where = None if best.origin is None else places(positions, best.origin)
        else:
            where = geodetic(flight, positions)
        if where is not None:
            lines.append(
                _line(name, " ".join(f"{lon:.8f},{lat:.8f},{height:.2f}" for lat, lon, height in where.tolist()))
            )
    if not lines:
        raise DataError("This log does not tell where on Earth the flight was: there is no path for a map.")
    title = escape(f"vehicle {flight.vehicle}, boot {flight.boot}")
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<name>{title}</name>{''.join(lines)}</Document></kml>\n",
        encoding="utf-8",
    )
    return [path]


def _line(name: str, coordinates: str) -> str:
    r, g, b = COLOURS[name]
    return (
        f"<Placemark><name>{_NAMES[name]}</name><Style><LineStyle><color>ff{b:02x}{g:02x}{r:02x}</color>"
        "<width>3</width></LineStyle></Style><LineString><altitudeMode>absolute</altitudeMode>"
        f"<coordinates>{coordinates}</coordinates></LineString></Placemark>\n"
    )


FORMATS = (
    Format("kml", "the paths for Google Earth", lambda path, c: write_kml(path, c.flight, c.shown, c.assessment.best)),
)
