"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""

from companion.analysis.findings.aiding import screened_aiding
from companion.analysis.findings.detect import autopilot_findings, findings, reading_faults, when_lost, with_reports
from companion.analysis.findings.readings import rate_warning
from companion.analysis.findings.stuck import missed_findings
