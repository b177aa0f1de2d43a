from __future__ import annotations

import contextlib
import gc
import importlib
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from playwright.sync_api import Browser, sync_playwright

from tests.recordings import ROOT
from tests.remembered import remembering, within_a_process
from tests.view.browsing import CHROMIUM, FLAGS, rank_with_the_tests

# The same examples every time, and no deadline: neither chance nor a busy machine is a failure.
# pytest --hypothesis-profile=explore looks for new ones.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("steady")

_REMEMBERED = (
    ("companion.app.examination", "assess"),
    ("companion.api", "smooth"),
    ("companion.cli.smooth", "smooth"),
    ("companion.verdict.assessment", "calibrate"),
    ("companion.verdict.assessment", "expected_over"),
    ("companion.view.export", "replay_page"),
)
"""Pure functions that take longer than to pickle their result, in the modules that call them."""

LONG = Path(__file__).with_name("long.txt")
"""Tests that take more than some seconds each: whole recordings through the whole product, again and again."""

# A shell that starts the tests in the background has SIGINT ignored, and so would every process of theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Two processes more than cores: those of the browser and of live links wait most of the time."""
    return (os.cpu_count() or 1) + 2


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Processes that share the files begin to load them at different ones: what one has compiled the others find."""
    worker, tests = os.environ.get("PYTEST_XDIST_WORKER"), ROOT / "tests"
    if worker and tests in [Path(asked).resolve() for asked in session.config.args]:
        files = sorted(tests.rglob("test_*.py"))
        first = len(files) * int(worker.removeprefix("gw")) // int(os.environ["PYTEST_XDIST_WORKER_COUNT"])
        for file in files[first:] + files[:first]:
            with contextlib.suppress(Exception, pytest.skip.Exception):  # told when it is collected
                importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What drives a browser or a cluster is slow, and begins first where several processes share the files.

    The other slow ones follow: what is left for the end is short, and no process is alone with it. What tests/long.txt
    names is left out by `make test`.
    """
    named = set(LONG.read_text(encoding="utf-8").splitlines())
    for item in items:
        if {item.location[0], item.nodeid.split("[")[0], item.nodeid} & named:
            item.add_marker(pytest.mark.long)
    long = {item.location[0] for item in items if {"browser", "cluster"} & set(getattr(item, "fixturenames", ()))}
    for item in items:
        if item.location[0] in long:
            item.add_marker(pytest.mark.slow)
    if "PYTEST_XDIST_WORKER" in os.environ:
        slow = {item.location[0] for item in items if item.get_closest_marker("slow")} - long
        items.sort(key=lambda item: (item.location[0] not in long, item.location[0] not in slow))


def pytest_collection_finish() -> None:
    """What is loaded by now stays: Python need not look through a million objects again and again for what has gone."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One line says how much was not run, and for want of what."""
    stats = terminalreporter.stats
    reports = stats.get("skipped", [])
    reasons = Counter(str(report.longrepr[2]).removeprefix("Skipped: ") for report in reports)
    if reasons:
        lacking = "; ".join(f"{count} ({reason})" for reason, count in reasons.most_common())
        asked = sum(len(stats.get(end, ())) for end in ("passed", "failed", "error", "skipped"))
        terminalreporter.write_line(f"Not run: {len(reports)} of {asked} tests: {lacking}")


@pytest.fixture(scope="session", autouse=True)
def _remembered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Commands, reports and pages that analyse the same flight share the answer, in CI not with other processes."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "answers"
    folder.mkdir(exist_ok=True)
    alone = os.environ.get("CI") == "true"
    with pytest.MonkeyPatch.context() as patch:
        for module, name in _REMEMBERED:
            where = importlib.import_module(module)
            pure = getattr(where, name)
            patch.setattr(where, name, within_a_process(pure) if alone else remembering(pure, folder))
        yield


@pytest.fixture(scope="session", autouse=True)
def state_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What commands remember between runs is none of the user's."""
    os.environ["XDG_STATE_HOME"] = os.environ["LOCALAPPDATA"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Of each module its own: Playwright keeps an event loop running, which other modules' asyncio would meet."""
    if not CHROMIUM.exists():
        reason = f"no Chromium at {CHROMIUM}: apt-get install chromium-headless-shell, or set CHROMIUM to its path"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    rank_with_the_tests()
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()
