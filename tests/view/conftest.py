from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from companion.model import Flight
from tests.view.browsing import new_page
from tests.view.circles import make_flight


@pytest.fixture
def flight() -> Flight:
    """A minute of circles."""
    return make_flight()


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    with new_page(browser) as page:
        yield page


@pytest.fixture
def wide_page(browser: Browser) -> Iterator[Page]:
    with new_page(browser, 1600, 900) as page:
        yield page
