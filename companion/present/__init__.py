"""How numbers become words, tables and colours: one definition for terminal, page and report."""

from companion.model import words
from companion.present import markup, palette
from companion.present.calibration import (
    CALIBRATED,
    CalibratedPart,
    by_best_estimate,
    held_out_gain,
    level_force,
    not_observable,
)
from companion.present.columns import AXES, QUANTITIES, STATISTICS, Quantity
from companion.present.findings import MOST_LINES, FindingGroup, flight_words, grouped, ranked, span
from companion.present.formats import (
    autopilot_words,
    clause,
    fixed,
    length,
    method_words,
    percent,
    severity_word,
    short,
    significant,
    vehicle_words,
)
from companion.present.markup import Link, details, html_table, paragraph, table, text
from companion.present.noise import SENSORS, density, interval
from companion.present.palette import Rgb, of_imus
from companion.present.tables import (
    Cell,
    Column,
    Table,
    agreement_table,
    dominant,
    drift_table,
    expected_table,
    redundant_imus_table,
)

__all__ = [
    "AXES",
    "CALIBRATED",
    "MOST_LINES",
    "QUANTITIES",
    "SENSORS",
    "STATISTICS",
    "CalibratedPart",
    "Cell",
    "Column",
    "FindingGroup",
    "Link",
    "Quantity",
    "Rgb",
    "Table",
    "agreement_table",
    "autopilot_words",
    "by_best_estimate",
    "clause",
    "density",
    "details",
    "dominant",
    "drift_table",
    "expected_table",
    "fixed",
    "flight_words",
    "grouped",
    "held_out_gain",
    "html_table",
    "interval",
    "length",
    "level_force",
    "markup",
    "method_words",
    "not_observable",
    "of_imus",
    "palette",
    "paragraph",
    "percent",
    "ranked",
    "redundant_imus_table",
    "severity_word",
    "short",
    "significant",
    "span",
    "table",
    "text",
    "vehicle_words",
    "words",
]
