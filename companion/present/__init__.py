"""How numbers become words, tables and colours: one definition for terminal, page and report."""

from companion.model import words
from companion.present import markup, palette
from companion.present.columns import AXES, QUANTITIES, STATISTICS, Quantity, held_out_gain
from companion.present.formats import autopilot_words, clause, fixed, length, percent, short, significant, vehicle_words
from companion.present.markup import Link, details, paragraph, table, text
from companion.present.palette import Rgb, of_imus

__all__ = [
    "AXES",
    "QUANTITIES",
    "STATISTICS",
    "Link",
    "Quantity",
    "Rgb",
    "autopilot_words",
    "clause",
    "details",
    "fixed",
    "held_out_gain",
    "length",
    "markup",
    "of_imus",
    "palette",
    "paragraph",
    "percent",
    "short",
    "significant",
    "table",
    "text",
    "vehicle_words",
    "words",
]
