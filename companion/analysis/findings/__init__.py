"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""

from companion.analysis.findings.aiding import screened_aiding
from companion.analysis.findings.consequences import when_lost, with_reports
from companion.analysis.findings.detect import autopilot_findings, findings, reading_faults
from companion.analysis.findings.sampling import rate_warning
from companion.analysis.findings.stuck import missed_findings
