"""A run over a fleet's logs: new and changed ones are examined, and all that is known is written.

A run leaves five Parquet tables and the page in its folder. Nothing is written where nothing has changed.
"""

from __future__ import annotations

import contextlib
import hashlib
import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import msgspec

from companion.app.files import replacing, write
from companion.app.settings import Settings
from companion.fleet.cluster import examine_all, local_cluster, remote_cluster
from companion.fleet.journal import MEMORY_GB, TIMEOUT_S, Journal, LogRecord, Plan, printable, version_of
from companion.fleet.page import fleet_html
from companion.fleet.rows import COLUMNS, Rows, arrow_table, rows_of
from companion.fleet.search import FoundLog
from companion.installation import missing
from companion.model import InputError


@dataclass(frozen=True, slots=True)
class FleetRun:
    """The options of a run."""

    folder: Path  # of the results
    settings: Settings
    imu: str | None = None  # message to integrate
    imu_model: str | None = None  # part of config/imu
    reports: bool = False  # write each flight's report too
    workers: int | None = None  # processes of this computer; None: one for each processor
    scheduler: str | None = None  # of an existing cluster, in place of processes of this computer
    retry: bool = False  # examine those again whose row is an error
    memory_gb: float = MEMORY_GB  # for one log
    timeout_s: float = TIMEOUT_S  # for one log


@dataclass(frozen=True, slots=True)
class Fleet:
    """The result of a run."""

    rows: Rows
    logs: int  # that were named
    examined: int  # in this run
    unchanged: int  # known from an earlier one
    written: tuple[Path, ...]

    @property
    def complete(self) -> bool:
        """False after Ctrl-C: the same command goes on from there."""
        return self.examined + self.unchanged == self.logs


Progress = Callable[[int, int], None]
"""Called with how many logs of how many new ones are done."""


def run_fleet(run: FleetRun, logs: Sequence[FoundLog], progress: Progress | None = None) -> Fleet:
    """Examine the logs that the folder does not know yet, and write what is known of all of them.

    Ctrl-C ends the run early and is no error: see `Fleet.complete`. Raises InputError for a missing library, a folder
    that cannot be written to and a scheduler that does not answer; what was examined by then is kept.
    """
    if find_spec("pyarrow") is None:  # before any work is done
        raise missing("fleet", "the tables are written with pyarrow")
    version = version_of(run.settings, run.imu, run.imu_model)
    plan = Plan(
        version=version,
        settings=msgspec.msgpack.encode(run.settings),
        imu=run.imu,
        imu_model=_absolute(run.imu_model),
        folder=str(run.folder.resolve()) if run.reports else None,
        memory_gb=run.memory_gb,
        timeout_s=run.timeout_s,
    )
    with Journal(run.folder, version) as journal:
        done = {log.path: record for log in logs if (record := journal.record(log)) and not _again(run, record)}
        unchanged = len(done)
        new = [log for log in logs if log.path not in done]

        def known(log: FoundLog) -> list[str]:
            return [sha256 for sha256, record in journal.same_size(log).items() if not _again(run, record)]

        try:
            if new:
                report = progress or (lambda *_: None)
                report(0, len(new))
                cluster = remote_cluster(run.scheduler) if run.scheduler else local_cluster(run.workers, len(new))
                with contextlib.suppress(KeyboardInterrupt), cluster as client:
                    for log, record in examine_all(client, new, plan, known):
                        done[log.path] = journal.add(log, record)
                        report(len(done) - unchanged, len(new))
        finally:
            records = [(log, done[log.path]) for log in logs if log.path in done]
            written = write_results(run.folder, records, _about(run, version))
    return Fleet(rows_of(records), len(logs), len(done) - unchanged, unchanged, tuple(written))


def _again(run: FleetRun, record: LogRecord) -> bool:
    """Whether a log has to be examined although its content is known."""
    failed = record.error is not None or any(flight.error is not None for flight in record.flights)
    pages = [flight.report for flight in record.flights if flight.analysis is not None]
    lacking = run.reports and not all(page and (run.folder / page).is_file() for page in pages)
    return not record.settled or lacking or (run.retry and failed)


def _absolute(imu_model: str | None) -> str | None:
    """A noise specification by a path that means the same in every process."""
    return str(Path(imu_model).resolve()) if imu_model and imu_model.endswith(".toml") else imu_model


def _about(run: FleetRun, version: str) -> dict[str, str]:
    """How the rows were made, for whoever reads them."""
    return {
        "companion": metadata.version("mavlink-companion"),
        "version": version,
        "settings": msgspec.json.encode(run.settings).decode(),
        "imu": run.imu or "the default of each autopilot",
        "imu_model": run.imu_model or "what the parameters name",
    }


PAGE = "fleet.html"
_STATE = b"state"


def write_results(folder: Path, logs: Sequence[tuple[FoundLog, LogRecord]], about: Mapping[str, str]) -> list[Path]:
    """Write tables and page, each replaced in one step; [] when they are there and up to date.

    about: how the rows were made, stated on the page and in the metadata of each table. Raises InputError when a
    library is missing or the folder cannot be written to.
    """
    import pyarrow.parquet as pq  # noqa: PLC0415  (an extra)

    known = [(printable(log.path), record) for log, record in logs]
    state = hashlib.sha256(msgspec.json.encode([known, about], order="sorted")).hexdigest()
    paths = [*(folder / f"{name}.parquet" for name in COLUMNS), folder / PAGE]
    if all(path.is_file() for path in paths) and _state_of(paths[0]) == state:
        return []
    rows = rows_of(logs)
    page = _page(rows, about)
    try:
        write(paths[-1], page)
        for name, path in [*zip(COLUMNS, paths[:-1], strict=True)][::-1]:  # "flights", with the state, last
            table = arrow_table(name, getattr(rows, name))
            with replacing(path) as draft:
                pq.write_table(table.replace_schema_metadata({**about, "state": state}), draft)
    except InputError as error:
        raise InputError(f"{error} What was examined is kept.") from None
    return paths


def _page(rows: Rows, about: Mapping[str, str]) -> str:
    """The page; where it cannot be drawn, one with the reason: the tables are not lost for that."""
    try:
        return fleet_html(rows, [(name.replace("_", " "), value) for name, value in about.items()])
    except Exception as error:  # noqa: BLE001
        reason = html.escape(f"{type(error).__name__}: {error}")
        return f"<!doctype html><title>Fleet</title><p>This page cannot be drawn ({reason}). The tables are beside it."


def _state_of(path: Path) -> str | None:
    """The state that a table was made of; None for a file that is none of ours."""
    import pyarrow as pa  # noqa: PLC0415
    import pyarrow.parquet as pq  # noqa: PLC0415

    try:
        metadata = pq.read_schema(path).metadata or {}
    except (OSError, pa.ArrowInvalid):
        return None
    return metadata.get(_STATE, b"").decode() or None
