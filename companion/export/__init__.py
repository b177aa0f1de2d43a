"""Results for other tools: tables for notebooks, CSV, Parquet and JSON; trajectories for evo; MCAP for Foxglove.

And KML for Google Earth, annotations for Flight Review.
"""

from collections.abc import Mapping
from importlib import import_module
from pkgutil import iter_modules

from companion.export.mcap import write_mcap
from companion.export.paths import write_estimate_tum, write_kml, write_tum
from companion.export.table import (
    Column,
    Contents,
    Format,
    Table,
    harmless,
    listed,
    series_name,
    thinned,
    write_csv,
    write_json,
    write_parquet,
)
from companion.export.tracks import assessed_replay, tables
from companion.export.yaml import kalibr_text, write_annotations

reckoning_of = assessed_replay  # deprecated: its old name


_MODULES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]
FORMATS: Mapping[str, Format] = {one.name: one for module in _MODULES for one in getattr(module, "FORMATS", ())}
"""Name → format: what each module here has in its own `FORMATS`. A new one is one new module."""
