"""How numbers become words, tables and colours: one definition for terminal, page and report."""

from companion.model import words
from companion.present import markup, palette
from companion.present.columns import AXES, QUANTITIES, STATISTICS, Quantity, held_out_gain
from companion.present.findings import MOST_LINES, FindingGroup, flight_words, grouped, ranked, span
from companion.present.formats import autopilot_words, clause, fixed, length, percent, short, significant, vehicle_words
from companion.present.markup import Link, details, paragraph, table, text
from companion.present.palette import Rgb, of_imus

__all__ = [
    "AXES",
    "MOST_LINES",
    "QUANTITIES",
    "STATISTICS",
    "FindingGroup",
    "Link",
    "Quantity",
    "Rgb",
    "autopilot_words",
    "clause",
    "details",
    "fixed",
    "flight_words",
    "grouped",
    "held_out_gain",
    "length",
    "markup",
    "of_imus",
    "palette",
    "paragraph",
    "percent",
    "ranked",
    "short",
    "significant",
    "span",
    "table",
    "text",
    "vehicle_words",
    "words",
]
