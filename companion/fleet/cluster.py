"""The cluster that examines the logs: worker processes of this computer, or a scheduler that runs already."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

from companion.fleet.journal import LogRecord, Plan
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
def local_cluster(workers: int | None, most: int) -> Iterator[Client]:
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
def remote_cluster(address: str) -> Iterator[Client]:
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


def examine_all(
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
    client: Client,
    logs: Sequence[FoundLog],
    plan: Plan,
    known: Callable[[FoundLog], Collection[str]],
    *,
    at_once: int,
) -> Iterator[tuple[FoundLog, LogRecord | None]]:
    """Each log with its record; None where the scheduler gave up because workers died."""
    distributed = _distributed()
    waiting = iter(logs)
    owner: dict[str, FoundLog] = {}

    def submit(log: FoundLog) -> Future[bytes]:
        future: Future[bytes] = client.submit(examine_log, log.path, plan, known(log), pure=False)
        owner[str(future.key)] = log
        return future

    first = list(map(submit, islice(waiting, at_once)))
    done = distributed.as_completed(first, loop=client.loop)  # with_results: a result that does not come is waited for
    for future in _patiently(client, done, 2 * plan.timeout_s + _SPARE_S):
        if future is None:
            for log in (*owner.values(), *waiting):
                yield log, LogRecord(error=_SILENT.format(seconds=2 * plan.timeout_s + _SPARE_S), settled=False)
            return
        log = owner.pop(str(future.key))
        if future.status == "finished":
            yield log, decode(future.result(timeout=_SPARE_S))
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
