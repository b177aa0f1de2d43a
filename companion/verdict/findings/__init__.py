"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""

from companion.verdict.findings.aiding import screened_aiding
from companion.verdict.findings.detect import autopilot_findings, findings, reading_faults, when_lost, with_reports
from companion.verdict.findings.readings import rate_warning
from companion.verdict.findings.stuck import missed_findings
