"""Everything that a session may ever send, against vehicles that write down what they got."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from companion.mavlink import Choice, Decoder, Link, Session, load_dialect, split_messages
from companion.mavlink.requests import ALLOWED_COMMANDS, ALLOWED_MESSAGES
from companion.simulate import Faults, SimulatedVehicle
from tests.mavlink.peers import wait_for
from tests.simulated import flying

VEHICLES: dict[str, dict[str, Any]] = {
    "ardupilot": {},
    "px4": {"autopilot": "px4"},
    "old firmware": {"faults": Faults(denied=frozenset("*"))},
    "promises": {"faults": Faults(never=frozenset({"HIGHRES_IMU"}))},
    "turned down": {"faults": Faults(turned_down=(9.0,))},
    "lossy": {"faults": Faults(drop=0.3, duplicate=0.1, reorder=0.1, garbage=0.1)},
}


@contextlib.contextmanager
def written_down(vehicle: SimulatedVehicle) -> Iterator[tuple[Counter[str], Counter[int]]]:
    """The names of the messages, and the numbers of the commands, that a vehicle gets from now on."""
    dialect, names, commands = load_dialect(), Counter[str](), Counter[int]()
    decoder, receive = Decoder(dialect, stamped=False), vehicle.receive

    def note(data: bytes) -> None:
        for name, messages in split_messages(decoder.push(data), dialect).items():
            names[name] += len(messages)
            if name == "COMMAND_LONG":
                commands.update(messages["command"].tolist())
        receive(data)

    vehicle.receive = note  # type: ignore[method-assign]
    yield names, commands


@pytest.fixture(scope="module")
def everything() -> tuple[Counter[str], Counter[int]]:
    """Every kind of session, from the first heartbeat to the leave."""
    names, commands = Counter[str](), Counter[int]()
    for manners in VEHICLES.values():
        with (
            Link("udpin:127.0.0.1:0") as link,
            flying(link.port, since=8.0, **manners) as vehicle,
            written_down(vehicle) as (own_names, own_commands),
        ):
            session = Session(link, choice=Choice(vehicle="all"))

            def goes_on(until: int, session: Session = session) -> bool:
                session.step(0.02)
                return session.rates is not None and session.rates.settled and session.report().frames > until

            wait_for(lambda: goes_on(150), 15.0)
            if "autopilot" not in manners:
                vehicle.reboot()
            frames = session.report().frames
            wait_for(lambda: goes_on(frames + 150), 15.0)
            session.leave()
            names += own_names
            commands += own_commands
    return names, commands


def test_this_is_all_that_is_ever_sent(everything: tuple[Counter[str], Counter[int]]) -> None:
    names, commands = everything
    print("sent:", dict(names), "commands:", dict(commands))
    assert set(names) == {"HEARTBEAT", "COMMAND_LONG", "REQUEST_DATA_STREAM", "PARAM_REQUEST_READ", "TIMESYNC"}
    assert set(names) == ALLOWED_MESSAGES
    assert set(commands) == {510, 511, 512} == ALLOWED_COMMANDS
