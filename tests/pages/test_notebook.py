"""The page that a notebook opens: served beside the session, and the same that the command line serves."""

from __future__ import annotations

import asyncio
import re
import signal
import socket
import sys
import threading
import urllib.error
import urllib.request
from dataclasses import replace
from pathlib import Path

import pytest

import companion as c
from companion.model import Flight
from companion.pages import replay as replay_page
from companion.present import headline
from companion.simulate import SimulatedVehicle, fly, write_flight
from tests.processes import ended, started
from tests.recordings import BUNDLED
from tests.view.browser_messages import plain_page
from tests.view.circles import make_flight

DEMO = BUNDLED / "copter-demo-100hz.tlog"


@pytest.fixture
def flight() -> Flight:
    return make_flight()


def fetched(url: str) -> str:
    with urllib.request.urlopen(url) as answer:
        body: str = answer.read().decode()
    return body


def told(url: str, *words: str) -> None:
    """Open the page, and wait until it has been told these."""
    with plain_page(url) as page:
        page.listen(lambda: all(word in str(page.messages) for word in words))


def threads() -> set[str]:
    return {thread.name for thread in threading.enumerate() if thread.name == "companion-view"}


def test_a_page_is_served_until_it_is_closed() -> None:
    handler = signal.getsignal(signal.SIGINT)
    page = c.show(make_flight())
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+", page.url)
    assert repr(page) == f"Replay of vehicle 1:1, boot 1: {page.url}"
    assert f'<a href="{page.url}" target="_blank" rel="noopener">' in page._repr_html_()
    assert "<html" in fetched(page.url)
    assert not page.closed
    assert signal.getsignal(signal.SIGINT) is handler
    page.close()
    page.close()
    assert page.closed
    assert repr(page) == page._repr_html_() == "Replay of vehicle 1:1, boot 1: closed"
    with pytest.raises(urllib.error.URLError):
        fetched(page.url)
    assert not threads()


def test_several_are_served_at_once() -> None:
    with c.show(make_flight()) as one, c.show([make_flight(sysid=2), make_flight(sysid=3)]) as other:
        assert one.url != other.url
        assert "vehicle 1:1" in repr(one)
        assert "vehicle 2:1" in repr(other)
        for page in (one, other):
            assert "<html" in fetched(page.url)
        told(other.url, "vehicle 3:1")  # to be chosen


def test_a_cell_of_a_notebook_runs_in_an_event_loop() -> None:
    async def cell() -> str:
        with c.show(make_flight()) as page:
            return await asyncio.to_thread(fetched, page.url)

    assert "<html" in asyncio.run(cell())


def test_a_path_is_shown_as_the_command_shows_it(tmp_path: Path) -> None:
    log = tmp_path / "a <log>.tlog"
    streams = {"RAW_IMU": 50.0, "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 10.0}
    write_flight(SimulatedVehicle(fly(20.0, motion="circle", seed=1), streams=streams, seed=1), log)
    with c.show(str(log)) as page:
        assert repr(page) == f"Replay of a <log>.tlog, vehicle 1:1, boot 1: {page.url}"
        assert "a &lt;log&gt;.tlog" in page._repr_html_()
        told(page.url, "vehicle 1:1, boot 1", "The report (HTML)")


def test_an_examination_is_shown_as_it_was_examined(monkeypatch: pytest.MonkeyPatch) -> None:
    how = c.Integration(method="midpoint", gravity=9.81)
    examined = c.examine(c.open_log(DEMO)[0], imu="SCALED_IMU2", how=how)

    def again(*_: object, **__: object) -> None:
        raise c.DataError("examined once more")

    monkeypatch.setattr(replay_page, "examine", again)
    with c.show(examined) as page:
        told(page.url, "SCALED_IMU2 alone", headline(examined.assessment.verdict).sentence)
    with pytest.raises(c.SettingsError, match="as it was examined"):
        c.show(examined, imu="RAW_IMU")
    with pytest.raises(c.SettingsError, match="as it was examined"):
        c.show(examined, anchor="rest")


def test_what_cannot_be_shown_is_refused_in_words(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(c.DataError, match="no attitude"):
        c.show(replace(flight, attitude=None))
    with pytest.raises(c.DataError, match="no usable HIGHRES_IMU"):
        c.show(flight, imu="HIGHRES_IMU")
    with pytest.raises(c.DataError, match="nothing to show"):
        c.show([])
    with pytest.raises(c.InputError):
        c.show(tmp_path / "none.tlog")
    with pytest.raises(c.SettingsError, match="anchor is"):
        c.show(flight, anchor="gps")
    with pytest.raises(TypeError, match="and no int"):
        c.show(5)  # type: ignore[arg-type]
    assert not threads(), "nothing is served then"


def test_a_port_that_is_taken_is_no_other_one(flight: Flight) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(c.InputError, match=f"Port {port} cannot be opened on 127.0.0.1: taken"):
            c.show(flight, port=port)
    with c.show(flight, port=port) as page:
        assert page.url.endswith(f":{port}")


SESSION = f"""
import os, signal, sys, urllib.request
import companion as c
sys.modules["viser"] = None
flight = c.open_log({str(DEMO)!r})[0]
try:
    c.show(flight)
except c.InputError as error:
    print(error)
del sys.modules["viser"]
url = c.show(flight).url
try:
    os.kill(os.getpid(), signal.SIGINT)
    signal.pause()
except KeyboardInterrupt:
    print("interrupted")
print(urllib.request.urlopen(url).status)
"""


def test_a_session_keeps_its_interrupt_and_ends_by_itself() -> None:
    with started(sys.executable, "-c", SESSION) as process:
        said, complained = ended(process)
    lines = said.splitlines()
    assert "the page needs viser, and it cannot be loaded" in lines[0]
    assert lines[1:] == ["interrupted", "200"]
    assert (process.returncode, complained) == (0, "")
