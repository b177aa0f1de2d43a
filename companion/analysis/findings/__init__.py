"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""

from companion.analysis.findings.aiding import screened_aiding
from companion.analysis.findings.consequences import with_reports
from companion.analysis.findings.control import when_lost
from companion.analysis.findings.detect import autopilot_findings, findings, reading_faults
from companion.analysis.findings.missed import missed_findings
from companion.analysis.findings.sampling import rate_warning

__all__ = [
    "autopilot_findings",
    "findings",
    "missed_findings",
    "rate_warning",
    "reading_faults",
    "screened_aiding",
    "when_lost",
    "with_reports",
]
