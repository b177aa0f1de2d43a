"""Text, tables and colours of results: one definition for terminal, page and report."""

from companion.model import words
from companion.present import markup, palette
from companion.present.checks import (
    OUTCOMES,
    judgement_lines,
    lane_lines,
    lane_table,
    preflight_headline,
    preflight_table,
)
from companion.present.findings import (
    MOST_LINES,
    FindingGroup,
    cause_lines,
    facts,
    flight_lines,
    grouped,
    heading,
    headline,
    incident_markdown,
    lasting,
    likeliest,
    ranked,
    span,
    timeline,
    wrong,
)
from companion.present.formats import (
    SENSORS,
    autopilot_words,
    capitalised,
    clause,
    density,
    fixed,
    interval,
    length,
    method_words,
    percent,
    plus_minus,
    severity_of,
    severity_word,
    short,
    shown_unit,
    significant,
    vehicle_words,
    with_unit,
)
from companion.present.markup import details, html_table, paragraph, sanitised, table, text
from companion.present.palette import Rgb, of_imus
from companion.present.tables import (
    AXES,
    CALIBRATED,
    QUANTITIES,
    STATISTICS,
    Cell,
    Table,
    agreement_table,
    by_best_estimate,
    dominant,
    drift_table,
    expected_table,
    held_out_gain,
    left_out_lines,
    level_force,
    not_observable,
    redundant_imus_table,
)
