"""The paths of a flight: as lines for maps and 3D views, as KML (OGC 2.3) for maps, as trajectory files for evo.

KML is what Google Earth and QGIS read. evo reads `timestamp x y z qx qy qz qw`, one pose a line (TUM RGB-D benchmark).
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from companion.comparison import Replay
from companion.estimation import BestEstimate
from companion.export.table import Format
from companion.model import Array, DataError, Flight, Origin, geodetic_from_ned, ned_from_geodetic

MOST_POINTS = 5000
"""A line of more is slow to draw in Foxglove and Google Earth, and looks the same."""

COLOURS = {"autopilot": (0, 114, 178), "imu": (230, 97, 1), "best": (0, 158, 115)}
"""As in the viewer: blue, vermillion, bluish green (Okabe and Ito)."""


def paths(shown: Replay, best: BestEstimate | None) -> dict[str, Array]:
    """Source → its path (N, 3) NED m of the flight's origin; none where the log has no position.

    The best estimate counts from its own origin, which is the flight's only where that is a fix: see `BestEstimate`.
    """
    if not shown.has_position:
        return {}
    by_source = {"autopilot": shown.position_ref, "imu": shown.position_imu}
    if best is not None and "gps_position" in best.residuals:
        by_source["best"] = best.position
    return {name: _few(path) for name, path in by_source.items()}


def _few(path: Array) -> Array:
    finite = path[np.isfinite(path).all(axis=1)]
    return finite[
        np.unique(np.linspace(0, max(len(finite) - 1, 0), min(len(finite), MOST_POINTS)).round().astype(np.intp))
    ]


def geodetic(flight: Flight, position: Array, best: BestEstimate | None = None) -> Array | None:
    """NED positions (N, 3) m of the flight, or of `best`, as latitude °, longitude °, height m above mean sea level.

    None when its place on Earth is unknown. The flight's origin may be the zero of the positions or a fix on the way
    (`Origin.t`): then the position at that time is that of the fix.
    """
    if best is not None:
        return None if best.origin is None else places(position, best.origin)
    origin, track = flight.origin, flight.position
    if origin is None or track is None:
        return None
    there = np.zeros(3)
    if origin.t is not None:
        there = np.array([np.interp(origin.t, track.t, axis) for axis in track.position.T])
    return places(position - there, origin)


def offset(flight: Flight, best: BestEstimate) -> Array:
    """(3,) m, to be added to the positions of `best`: they then count from the zero of the flight's, NED.

    0 where the place on Earth of either is unknown.
    """
    zero = geodetic(flight, np.zeros((1, 3)))
    if zero is None or best.origin is None:
        return np.zeros(3)
    latitude, longitude, height = zero[0].tolist()
    own = best.origin
    place = (np.array([own.latitude]), np.array([own.longitude]), np.array([own.height]))
    return np.asarray(ned_from_geodetic(*place, (math.radians(latitude), math.radians(longitude), height))[0])


def places(position: Array, origin: Origin) -> Array:
    """NED positions (N, 3) m about an origin as latitude °, longitude °, height m above mean sea level: (N, 3)."""
    place = geodetic_from_ned(position, (origin.latitude, origin.longitude, origin.height))
    return np.column_stack([np.degrees(place[:, :2]), place[:, 2]])


_NAMES = {"autopilot": "Autopilot (EKF)", "imu": "IMU alone", "best": "Best estimate"}


def write_kml(path: Path, flight: Flight, shown: Replay, best: BestEstimate | None = None) -> list[Path]:
    """A line for each path, heights above mean sea level.

    Raises DataError when the log has no position, or its place on Earth is unknown.
    """
    lines = []
    for name, positions in paths(shown, best).items():
        where = geodetic(flight, positions, best if name == "best" else None)
        if where is not None:
            coordinates = (f"{lon:.8f},{lat:.8f},{height:.2f}" for lat, lon, height in where.tolist())
            lines.append(_line(name, " ".join(coordinates)))
    if not lines:
        raise DataError("The log has no geographic position: there is no path for a map.")
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


def write_tum(folder: Path, flight: Flight, shown: Replay, best: BestEstimate | None = None) -> list[Path]:
    """autopilot.tum and imu.tum: the same times in both, those at which the autopilot's state is known.

    And best.tum where there is a best estimate, at every sample of its IMU.
    """
    known, paths = shown.reference_valid, []
    for name, what, q, position in (
        ("autopilot", "the autopilot's estimate", shown.q_ref, shown.position_ref),
        ("imu", "the IMU alone, from the autopilot's state at each anchor", shown.q_imu, shown.position_imu),
    ):
        about, place = f"{what}, {len(shown.anchors)} anchors", position[known] if shown.has_position else None
        paths.append(_write_poses(folder / f"{name}.tum", flight, about, shown.t[known], q[known], place))
    if best is not None:
        paths.append(write_estimate_tum(folder / "best.tum", flight, best))
    return paths


def write_estimate_tum(path: Path, flight: Flight, best: BestEstimate) -> Path:
    """The best estimate, carried to every sample of its IMU, about the zero of the flight's positions."""
    t = best.imu.t
    q, _, position = best.at(t)
    about = f"best estimate from {', '.join([best.imu.source, *best.residuals])}"
    return _write_poses(
        path, flight, about, t, q, position + offset(flight, best) if "gps_position" in best.residuals else None
    )


def _write_poses(path: Path, flight: Flight, about: str, t: Array, q: Array, position: Array | None) -> Path:
    """A pose a line, under a head that says what the columns are. position: None where it is not known."""
    epoch = f"add {flight.epoch.unix_s:.6f} for UNIX time" if flight.epoch else "the date is unknown"
    head = [
        f"{about}; vehicle {flight.vehicle}, boot {flight.boot}",
        f"t: s of the vehicle's boot clock ({epoch})",
        "x y z: north, east, down, m; qx qy qz qw: Hamilton, turns FRD (forward, right, down) into NED",
    ]
    if position is None:
        head.append("the log has no position: x y z are 0 throughout, only the attitudes mean something")
    place = np.zeros((len(t), 3)) if position is None else position
    rows = np.column_stack([t, place, np.roll(q, -1, axis=1)])  # scalar last
    with path.open("w", encoding="utf-8", newline="\n") as file:
        np.savetxt(file, rows, fmt="%.9f", header="\n".join(head))
    return path


FORMATS = (
    Format("kml", "the paths for Google Earth", lambda path, c: write_kml(path, c.flight, c.shown, c.assessment.best)),
    Format(
        "tum",
        "the trajectories for evo",
        lambda path, c: write_tum(path, c.flight, c.shown, c.assessment.best),
        is_folder=True,
    ),
)
