"""A layout for Foxglove that shows an exported flight: 3D, map, errors, findings. Import it with *Import from file*."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec

from companion.export.channels import write_channels
from companion.export.mcap import of_contents
from companion.export.table import Contents, Format

_CAMERA = {"perspective": True, "distance": 40, "phi": 60, "thetaOffset": 45, "fovy": 45, "near": 0.5, "far": 20000}
_GRID = {
    "layerId": "foxglove.Grid",
    "instanceId": "grid",
    "visible": True,
    "frameId": "enu",
    "size": 200,
    "divisions": 20,
}


def layout(topics: Collection[str]) -> dict[str, Any]:
    """The layout for a file with these topics."""
    panels: dict[str, dict[str, Any]] = {
        "3D!flight": {
            "cameraState": _CAMERA,
            "followMode": "follow-position",
            "followTf": "autopilot",
            "scene": {},
            "transforms": {},
            "topics": {"/paths": {"visible": True}},
            "layers": {"grid": _GRID},
        },
        "map!flight": {"followTopic": "/autopilot/location", "disabledTopics": [], "layer": "map", "zoomLevel": 16},
        "RosOut!findings": {"topicToRender": "/findings", "minLogLevel": 1, "searchTerms": []},
        "Plot!attitude": _plot("Attitude error, °", "/error.attitude_deg"),
        "Plot!position": _plot("Position error, m", "/error.position_m"),
        "RosOut!vehicle": {"topicToRender": "/statustext", "minLogLevel": 1, "searchTerms": []},
    }
    if "/autopilot/location" not in topics:
        del panels["map!flight"]
    first, *others = panels
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": first, "second": _column(others), "splitPercentage": 60},
    }


def _plot(title: str, value: str) -> dict[str, Any]:
    path = {"value": value, "enabled": True, "timestampMethod": "headerStamp"}
    return {
        "title": title, "paths": [path], "xAxisVal": "timestamp", "isSynced": True, "showLegend": False,
        "showXAxisLabels": True, "showYAxisLabels": True,
    }  # fmt: skip


def _column(names: list[str]) -> str | dict[str, Any]:
    """Panels of one height, one under the other."""
    first, *others = names
    if not others:
        return first
    share = 100 / len(names)
    return {"direction": "column", "first": first, "second": _column(others), "splitPercentage": share}


def _write(folder: Path, one: Contents) -> list[Path]:
    channels, about = of_contents(one)
    flight, arrangement = folder / "flight.mcap", folder / "layout.json"
    write_channels(flight, channels, about)
    text = msgspec.json.encode(layout({channel.topic for channel in channels}))
    arrangement.write_bytes(msgspec.json.format(text, indent=2))
    return [flight, arrangement]


FORMATS = (Format("foxglove", "the same with a layout", _write, is_folder=True),)
