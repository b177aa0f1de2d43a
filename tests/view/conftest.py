from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest
import viser
from playwright.sync_api import Browser, Page

from companion.model import Flight
from companion.view.server.web_server import Address, close_server, open_server
from tests.view.browsing import new_page
from tests.view.circles import make_flight


@pytest.fixture
def flight() -> Flight:
    """A minute of circles."""
    return make_flight()


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    """One that nobody watches."""
    server = open_server(Address("127.0.0.1", 0, loopback=True))
    yield server
    close_server(server)


class _Window:
    """The page that the tests of a module share: to load it takes most of what a test of it takes (`next_port`)."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._page: Page | None = None
        self._opened = contextlib.ExitStack()

    def page(self) -> Page:
        if self._page is None:
            self._page = self._opened.enter_context(new_page(self._browser))
        return self._page

    def close(self) -> None:
        self._page = None
        self._opened.close()


@pytest.fixture(scope="module")
def _window(browser: Browser) -> Iterator[_Window]:
    window = _Window(browser)
    yield window
    window.close()


def _of_size(window: _Window, request: pytest.FixtureRequest, width: int, height: int) -> Iterator[Page]:
    failed = request.session.testsfailed
    page = window.page()
    page.set_viewport_size({"width": width, "height": height})
    yield page
    if request.session.testsfailed > failed:
        window.close()  # whatever it shows now, the next test begins with another


@pytest.fixture
def page(_window: _Window, request: pytest.FixtureRequest) -> Iterator[Page]:
    yield from _of_size(_window, request, 1280, 800)


@pytest.fixture
def wide_page(_window: _Window, request: pytest.FixtureRequest) -> Iterator[Page]:
    yield from _of_size(_window, request, 1600, 900)
