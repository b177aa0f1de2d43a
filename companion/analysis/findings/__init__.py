"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""

from companion.analysis.findings.control import when_lost
from companion.analysis.findings.detect import findings, reading_faults
from companion.analysis.findings.sampling import rate_warning
from companion.analysis.findings.stuck import missed_findings

__all__ = ["findings", "missed_findings", "rate_warning", "reading_faults", "when_lost"]
