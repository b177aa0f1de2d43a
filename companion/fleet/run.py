"""A run over a fleet's logs: new and changed ones are examined on a cluster, and all that is known is written.

A run leaves five Parquet tables and the page in its folder. Nothing is written where nothing has changed. The cluster:
worker processes of this computer, or a scheduler that runs already.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import html
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from companion.app.files import replacing, write
from companion.app.settings import Settings
from companion.fleet.journal import MEMORY_GB, TIMEOUT_S, Journal, LogRecord, Plan, printable, version_of
from companion.fleet.page import fleet_html
from companion.fleet.rows import COLUMNS, Rows, arrow_table, rows_of
from companion.fleet.search import FoundLog
from companion.fleet.task import decode, examine_log
from companion.installation import missing
from companion.model import InputError

if TYPE_CHECKING:
    from distributed import Client, Future

_log = logging.getLogger(__name__)
_CONNECT_S = 10.0  # for a scheduler to answer, and for it to have a worker
_SPARE_S = 60.0  # for a worker that has died to come again, and for what a scheduler does between two answers
_LOOK_S = 0.02  # between two looks for a log that is done
_KEPT = "What was done is kept: run the same command again when it is back."
_ON_THE_WAY = 1000  # logs that are handed to the scheduler at a time: all would be slow for tens of thousands


@contextlib.contextmanager
def _local_cluster(workers: int | None, most: int) -> Iterator[Client]:
    """Worker processes of one thread each, which listen to this computer alone: one for each processor by default.

    `most`: as many as there is work for.
    """
    distributed = _distributed()
    from dask import config  # noqa: PLC0415  (comes with distributed)
    from dask.system import CPU_COUNT  # noqa: PLC0415

    with contextlib.ExitStack() as stack:
        if sys.platform == "linux":  # one process imports what every worker needs; elsewhere a copy of it may crash
            stack.enter_context(config.set({"distributed.worker.multiprocessing-method": "forkserver"}))
        with _interrupts_wait(), _failing("the worker processes cannot be started ({}). Try fewer: --workers 1"):
            cluster = distributed.LocalCluster(
                n_workers=min(workers or CPU_COUNT, most),
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                # without a dashboard it still answers for its health
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
                preload="companion.fleet.task",
            )
            stack.callback(_close, cluster)
            client: Client = distributed.Client(cluster, set_as_default=False)
            stack.callback(_close, client)
            _silence(client)
        yield client


@contextlib.contextmanager
def _failing(sentence: str) -> Iterator[None]:
    """What Dask raises where its event loop or its peers do not come to answer, as InputError: it is of many types."""
    try:
        yield
    except InputError:
        raise
    except (Exception, asyncio.CancelledError) as error:
        raise InputError(sentence.format(str(error) or type(error).__name__)) from error


def _close(one: Any) -> None:
    """Close a client or a cluster. What is done is done, whether that works or not."""
    with contextlib.suppress(Exception, asyncio.CancelledError):
        one.close()


@contextlib.contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Ctrl-C takes effect at the end: a cluster that is interrupted while it starts cannot be closed without noise."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    interrupts: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if interrupts:
        raise KeyboardInterrupt


@contextlib.contextmanager
def _remote_cluster(address: str) -> Iterator[Client]:
    """The workers of a scheduler that runs already.

    Raises InputError when nobody answers there within 10 s, or the scheduler has no worker.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"no Dask scheduler at {address} ({error}). Start one with: dask scheduler --host 127.0.0.1 --port 8786"
        ) from None
    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        stack.callback(_close, client)
        _silence(client)
        with _failing(f"the scheduler at {address} does not answer ({{}}). {_KEPT}"):
            try:
                client.wait_for_workers(1, timeout=_CONNECT_S)
            except TimeoutError:
                raise InputError(
                    f"the scheduler at {address} has no workers. Start some: dask worker {address} --nthreads 1"
                ) from None
        yield client


def _silence(client: Client) -> None:
    """What nobody waits for any more in Dask's event loop fails without a traceback in the terminal."""
    loop: Any = client.loop
    loop.asyncio_loop.set_exception_handler(lambda _, context: _log.debug("in Dask: %s", context.get("message")))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """What Dask logs of a scheduler that goes away, with tracebacks, is one sentence here."""
    handlers = [(one, one.level) for one in logging.getLogger("distributed").handlers]
    for handler, _ in handlers:
        handler.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for handler, level in handlers:
            handler.setLevel(level)


def _examine_all(
    client: Client, logs: Sequence[FoundLog], plan: Plan, known: Callable[[FoundLog], Collection[str]]
) -> Iterator[tuple[FoundLog, LogRecord]]:
    """Each log with its record, in the order in which they are done.

    A log whose worker dies is given to another one. The scheduler blames every log that a dead worker had waiting, so
    one that it has given up is tried once more, alone: only then it is the log's own doing. Where no log is done in
    twice the time that one is given, those that are left are rows too: a worker hangs, or all have gone.
    Raises InputError when the scheduler goes away, or does not answer.
    """
    suspects: list[FoundLog] = []
    with _failing(f"the scheduler does not answer ({{}}). {_KEPT}"):
        for log, record in _completed(client, logs, plan, known, at_once=_ON_THE_WAY):
            if record is None:
                suspects.append(log)
            else:
                yield log, record
        for log, record in _completed(client, suspects, plan, known, at_once=1):
            yield log, record or LogRecord(error=_DEADLY)


_DEADLY = (
    "every worker that examined it died: it was killed, or ran out of memory. "
    "Try it alone: companion analyze LOG; with more memory per worker: --workers 1"
)


def _completed(
    client: Client, logs: Sequence[FoundLog], plan: Plan, known: Callable[[FoundLog], Collection[str]], *, at_once: int
) -> Iterator[tuple[FoundLog, LogRecord | None]]:
    """Each log with its record; None where the scheduler gave up because workers died."""
    distributed = _distributed()
    waiting = iter(logs)
    owner: dict[str, FoundLog] = {}

    def submit(log: FoundLog) -> Future[bytes]:
        future: Future[bytes] = client.submit(examine_log, log.path, plan, known(log), pure=False)
        owner[str(future.key)] = log
        return future

    most_s = 2 * plan.timeout_s + _SPARE_S
    # with_results: a result that does not come is waited for
    done = distributed.as_completed(map(submit, islice(waiting, at_once)), loop=client.loop)
    for future in _patiently(client, done, most_s):
        if future is None:
            for log in (*owner.values(), *waiting):
                yield log, LogRecord(error=_SILENT.format(seconds=most_s), settled=False)
            return
        log = owner.pop(str(future.key))
        if future.status == "finished":
            yield log, decode(future.result(timeout=most_s))  # examined again where its worker died with it
        elif future.status == "error":
            error = future.exception()
            dead = isinstance(error, distributed.KilledWorker)
            yield log, None if dead else LogRecord(error=f"the worker failed: {error!r}", settled=False)
        else:
            raise InputError(f"the scheduler has gone. {_KEPT}")
        done.update(map(submit, islice(waiting, 1)))


_SILENT = (
    "no worker has finished any log for {seconds:g} s: they hang, or have gone. It is tried again by the same command"
)


def _patiently(client: Client, done: Any, most_s: float) -> Iterator[Any]:
    """The futures of an `as_completed`; None at the end where none comes in `most_s`.

    Raises InputError where the scheduler has had no worker for a minute.
    """
    since = staffed = time.monotonic()
    while done.count():
        now = time.monotonic()
        if done.has_ready():
            yield next(done)
            since = staffed = time.monotonic()
        elif now - since > most_s:
            yield None
            return
        elif now - staffed > _SPARE_S:
            if not client.scheduler_info()["workers"]:
                raise InputError(f"all workers have gone. {_KEPT}")
            staffed = now
        else:
            time.sleep(_LOOK_S)


def _distributed() -> Any:
    try:
        import distributed  # noqa: PLC0415  (an extra, and slow to import: only who has something to examine needs it)
    except ModuleNotFoundError:
        raise missing("fleet", "many logs are examined with Dask") from None
    return distributed


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
    journal = Journal(run.folder, version)
    done = {log.path: record for log in logs if (record := journal.record(log)) and not _again(run, record)}
    unchanged = len(done)
    new = [log for log in logs if log.path not in done]

    def known(log: FoundLog) -> list[str]:
        return [sha256 for sha256, record in journal.same_size(log).items() if not _again(run, record)]

    try:
        if new:
            report = progress or (lambda *_: None)
            report(0, len(new))
            cluster = _remote_cluster(run.scheduler) if run.scheduler else _local_cluster(run.workers, len(new))
            with contextlib.suppress(KeyboardInterrupt), cluster as client:
                for log, record in _examine_all(client, new, plan, known):
                    done[log.path] = journal.add(log, record)
                    report(len(done) - unchanged, len(new))
    finally:
        records = [(log, done[log.path]) for log in logs if log.path in done]
        written = write_results(run.folder, records, _about(run, version))
    return Fleet(rows_of(records), len(logs), len(done) - unchanged, unchanged, tuple(written))


def _again(run: FleetRun, record: LogRecord) -> bool:
    """Whether a log has to be examined although its content is known."""
    failed = record.error is not None or any(flight.error is not None for flight in record.flights)
    pages = [flight.report for flight in record.flights if flight.analysis and flight.analysis["used_imu"]]
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


def write_results(folder: Path, logs: Sequence[tuple[FoundLog, LogRecord]], about: Mapping[str, str]) -> list[Path]:
    """Write tables and page, each replaced in one step; [] when they are there and up to date.

    about: how the rows were made, stated on the page and in the metadata of each table. Raises InputError when a
    library is missing or the folder cannot be written to.
    """
    import pyarrow.parquet as pq  # noqa: PLC0415  (an extra)

    known = [(printable(log.path), record) for log, record in logs]
    state = hashlib.sha256(msgspec.json.encode([known, about], order="sorted")).hexdigest()
    paths = [*(folder / f"{name}.parquet" for name in COLUMNS), folder / PAGE]
    if all(path.is_file() and state.encode() in path.read_bytes() for path in paths):
        return []
    rows = rows_of(logs)
    try:
        write(paths[-1], f"{_page(rows, about)}\n<!-- state {state} -->\n")
        for name, path in zip(COLUMNS, paths[:-1], strict=True):
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
