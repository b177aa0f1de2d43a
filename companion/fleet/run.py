"""A fleet's logs, examined: only what is new or changed, and everything that is known of them as tables and a page."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from companion.fleet.cluster import examine_all, local_cluster, remote_cluster
from companion.fleet.journal import Journal
from companion.fleet.records import LogRecord, Plan
from companion.fleet.rows import Rows, rows_of
from companion.fleet.search import FoundLog
from companion.fleet.tables import require_arrow, write_tables
from companion.fleet.version import version_of
from companion.settings import Settings


@dataclass(frozen=True, slots=True)
class FleetRun:
    """How a fleet is examined, and by whom."""

    folder: Path  # of the results
    settings: Settings
    imu: str | None = None  # message to integrate
    imu_model: str | None = None  # part of config/imu
    reports: bool = False  # write each flight's report too
    workers: int | None = None  # processes of this computer; None: one for each processor
    scheduler: str | None = None  # of an existing cluster, in place of processes of this computer
    retry: bool = False  # examine those again whose row is an error


@dataclass(frozen=True, slots=True)
class Fleet:
    """What came of it."""

    rows: Rows
    logs: int  # that were asked for
    examined: int  # in this run
    unchanged: int  # known from an earlier one
    written: tuple[Path, ...]

    @property
    def complete(self) -> bool:
        """False after Ctrl-C: the same command goes on from there."""
        return self.examined + self.unchanged == self.logs


Progress = Callable[[int, int], None]
"""Told how many logs of how many new ones are done."""


def run_fleet(run: FleetRun, logs: Sequence[FoundLog], progress: Progress | None = None) -> Fleet:
    """Examine the logs that the folder does not know yet, and write what is known of all of them.

    Ctrl-C ends the run early and is no error: see `Fleet.complete`. Raises InputError for a missing library, a folder
    that cannot be written to and a scheduler that does not answer; what was examined by then is kept.
    """
    require_arrow()
    version = version_of(run.settings, run.imu, run.imu_model)
    plan = Plan(
        version=version,
        settings=msgspec.msgpack.encode(run.settings),
        imu=run.imu,
        imu_model=str(Path(run.imu_model).resolve())
        if run.imu_model and Path(run.imu_model).is_file()
        else run.imu_model,
    )
    with Journal(run.folder, version) as journal:
        done = {log.path: record for log in logs if (record := journal.record(log)) and not _again(run, record)}
        unchanged = len(done)
        new = [log for log in logs if log.path not in done]
        try:
            if new:
                told = progress or (lambda *_: None)
                told(0, len(new))
                cluster = remote_cluster(run.scheduler) if run.scheduler else local_cluster(run.workers, len(new))
                with contextlib.suppress(KeyboardInterrupt), cluster as client:
                    for log, record in examine_all(client, new, plan, journal.known):
                        done[log.path] = journal.add(log, record)
                        told(len(done) - unchanged, len(new))
        finally:
            rows = rows_of((log, done[log.path]) for log in logs if log.path in done)
            written = write_tables(run.folder, rows, {"version": version})
    return Fleet(rows, len(logs), len(done) - unchanged, unchanged, tuple(written))


def _again(run: FleetRun, record: LogRecord) -> bool:
    failed = record.error is not None or any(flight.error is not None for flight in record.flights)
    return not record.settled or (run.retry and failed)
