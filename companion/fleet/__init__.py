"""Many logs on dask.distributed: rows of every flight, in Parquet tables and on one page."""

from companion.fleet.digest import (
    by_concern,
    count_by_status,
    count_findings,
    errors,
    key_of,
    reasons,
    short_names,
    worst_ratios,
)
from companion.fleet.history import earlier_checks
from companion.fleet.limits import MEMORY_GB, TIMEOUT_S
from companion.fleet.rows import Row, Rows
from companion.fleet.run import Fleet, FleetRun, run_fleet
from companion.fleet.search import FoundLog, Search, find_logs
