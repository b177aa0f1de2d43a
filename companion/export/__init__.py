"""Results for other tools: tables for notebooks, CSV, Parquet and JSON; trajectories for evo; MCAP for Foxglove.

And KML for Google Earth, annotations for Flight Review.
"""

from collections.abc import Mapping

from companion.export import mcap, paths, rosbag2, table, yaml
from companion.export.mcap import write_mcap
from companion.export.paths import write_estimate_tum, write_kml, write_tum
from companion.export.table import (
    Column,
    Contents,
    Format,
    Table,
    csv_cell,
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

FORMATS: Mapping[str, Format] = {
    one.name: one for module in (yaml, table, mcap, paths, rosbag2) for one in module.FORMATS
}
"""Name → format, in the order in which they are listed. A new one is a row of its module's own `FORMATS`."""
