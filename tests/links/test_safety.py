"""Everything that a session may ever send, against vehicles that write down what they got."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest

from companion.links import Choice, Link, Session
from companion.links.requests import ALLOWED_COMMANDS, ALLOWED_MESSAGES, ANNOUNCEMENT
from companion.mavlink import Decoder, load_dialect, split_messages
from companion.simulate import Faults, SimulatedVehicle
from tests.simulated import flying
from tests.waiting import wait_for

pytestmark = pytest.mark.slow

VEHICLES: dict[str, dict[str, Any]] = {
    "ardupilot": {},
    "px4": {"autopilot": "px4"},
    "old firmware": {"faults": Faults(denied=frozenset("*"))},
    "promises": {"faults": Faults(never=frozenset({"HIGHRES_IMU"}))},
    "turned down": {"faults": Faults(turned_down=(9.0,))},
    "lossy": {"faults": Faults(drop=0.3, duplicate=0.1, reorder=0.1, garbage=0.1)},
}


@contextlib.contextmanager
def written_down(vehicle: SimulatedVehicle, names: Counter[str], commands: Counter[int]) -> Iterator[None]:
    """Count the messages by name, and the commands by number, that a vehicle gets from now on."""
    dialect, receive = load_dialect(), vehicle.receive
    decoder = Decoder(dialect, stamped=False)

    def note(data: bytes) -> None:
        for name, messages in split_messages(decoder.push(data), dialect).items():
            names[name] += len(messages)
            if name == "COMMAND_LONG":
                commands.update(messages["command"].tolist())
        receive(data)

    vehicle.receive = note  # type: ignore[method-assign]
    yield


def test_this_is_all_that_is_ever_sent() -> None:
    """Every kind of vehicle on one link, from the first heartbeat over a reboot to the leave."""
    names, commands = Counter[str](), Counter[int]()
    with Link("udpin:127.0.0.1:0") as link, contextlib.ExitStack() as flights:
        vehicles = []
        for sysid, manners in enumerate(VEHICLES.values(), 1):
            vehicles.append(flights.enter_context(flying(link.port, since=8.0, sysid=sysid, **manners)))
            flights.enter_context(written_down(vehicles[-1], names, commands))
        session = Session(link, choice=Choice("all", imu_hz=20.0, attitude_hz=10.0, position_hz=5.0))

        def agreed() -> bool:
            session.step(0.02)
            asked = [asked.rates for asked in session.requested.values() if asked.rates]
            return len(asked) == len(vehicles) and all(rates.settled for rates in asked)

        wait_for(agreed)
        before = commands[511]
        vehicles[0].reboot()
        wait_for(lambda: agreed() and commands[511] > before and commands[512] > 0)
        session.leave()
        wait_for(lambda: set(commands) == ALLOWED_COMMANDS and set(names) == ALLOWED_MESSAGES)
    print("sent:", dict(names), "commands:", dict(commands))
    assert set(names) == {"HEARTBEAT", "COMMAND_LONG", "REQUEST_DATA_STREAM", "PARAM_REQUEST_READ", "TIMESYNC"}
    assert set(names) == ALLOWED_MESSAGES
    assert ANNOUNCEMENT not in names, "nobody asked to announce"
    assert set(commands) == {510, 511, 512} == ALLOWED_COMMANDS
