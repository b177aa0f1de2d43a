"""Many logs on dask.distributed: rows of every flight, in Parquet tables and on one page."""

from companion.fleet.history import earlier_checks
from companion.fleet.journal import MEMORY_GB, TIMEOUT_S
from companion.fleet.rows import Row, Rows, key_of
from companion.fleet.run import Fleet, FleetRun, run_fleet
from companion.fleet.search import FoundLog, Search, find_logs, short_names
