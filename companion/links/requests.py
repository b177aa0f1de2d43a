"""What the companion may say to a vehicle. This is the whole of it: everything else raises. (`companion
replay` plays a recording to clients, and never to a serial port: `recordings`.)

Nothing here moves, arms or configures a vehicle. The companion looks on; it asks for data and for nothing more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from companion.mavlink import Messages, Value

GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 510, 511, 512  # MAV_CMD
ACCEPTED = 0  # MAV_RESULT

ALLOWED_MESSAGES = frozenset({"HEARTBEAT", "COMMAND_LONG", "REQUEST_DATA_STREAM", "PARAM_REQUEST_READ", "TIMESYNC"})
ANNOUNCEMENT = "STATUSTEXT"
"""Words for people at ground stations: sent only over a link that announces."""
ALLOWED_COMMANDS = frozenset({GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE})
"""The only values of COMMAND_LONG.command."""

_WARNING, _INFO = 4, 6  # MAV_SEVERITY
_ONBOARD_CONTROLLER, _NO_AUTOPILOT, _ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT_INVALID, MAV_STATE


class ForbiddenMessageError(ValueError):
    """Something tried to send what is not on the allow-list: a defect of companion, never of its user."""


class Target(NamedTuple):
    """The autopilot that a request is for, by the ids of what it sends."""

    sysid: int
    compid: int

    def __str__(self) -> str:
        return f"{self.sysid}:{self.compid}"


@dataclass(frozen=True, slots=True)
class Request:
    """One message to send. Raises ForbiddenMessageError unless the allow-list has it."""

    name: str
    fields: Mapping[str, Value]

    def __post_init__(self) -> None:
        if self.name not in ALLOWED_MESSAGES | {ANNOUNCEMENT}:
            raise ForbiddenMessageError(f"companion never sends {self.name}; it may send {sorted(ALLOWED_MESSAGES)}")
        if self.name == "COMMAND_LONG" and self.fields.get("command") not in ALLOWED_COMMANDS:
            raise ForbiddenMessageError(
                f"companion never sends MAV_CMD {self.fields.get('command')!r}; it may send {sorted(ALLOWED_COMMANDS)}"
            )


def heartbeat() -> Request:
    """That a companion computer is here.

    As an onboard controller, not as a ground station: a heartbeat of a GCS would keep ArduPilot's and PX4's GCS
    failsafe from firing when the real ground station is lost.
    """
    fields = {"type": _ONBOARD_CONTROLLER, "autopilot": _NO_AUTOPILOT, "system_status": _ACTIVE, "mavlink_version": 3}
    return Request("HEARTBEAT", fields)


def get_interval(target: Target, message_id: int) -> Request:
    """Ask how often a message is sent: answered by MESSAGE_INTERVAL."""
    return _command(target, GET_MESSAGE_INTERVAL, message_id)


def set_interval(target: Target, message_id: int, interval_us: int) -> Request:
    """Ask for a message every so many µs; -1 stops it, 0 gives it back its default."""
    return _command(target, SET_MESSAGE_INTERVAL, message_id, interval_us)


def request_message(target: Target, message_id: int) -> Request:
    """Ask for a message once."""
    return _command(target, REQUEST_MESSAGE, message_id)


def request_stream(target: Target, stream: int, rate_hz: int) -> Request:
    """MAV_DATA_STREAM at a rate, for firmware without SET_MESSAGE_INTERVAL; 0 Hz stops it."""
    fields = {"req_stream_id": stream, "req_message_rate": rate_hz, "start_stop": int(rate_hz > 0)}
    return Request("REQUEST_DATA_STREAM", _to(target) | fields)


def read_parameter(target: Target, name: str) -> Request:
    """Ask for one parameter's value: answered by PARAM_VALUE."""
    return Request("PARAM_REQUEST_READ", _to(target) | {"param_id": name.encode("ascii"), "param_index": -1})


def timesync(sent_ns: int) -> Request:
    """Ask for the vehicle's clock: answered by TIMESYNC with the same ts1."""
    return Request("TIMESYNC", {"tc1": 0, "ts1": sent_ns})


def announce(text: str, *, alarm: bool) -> Request:
    """Tell the people at ground stations something, in 50 characters at most; autopilots only pass it on."""
    severity = _WARNING if alarm else _INFO
    return Request(ANNOUNCEMENT, {"severity": severity, "text": f"companion: {text}".encode("ascii", "replace")[:50]})


def interval_results(messages: Mapping[str, Messages], own_sysid: int) -> list[int]:
    """MAV_RESULT of each COMMAND_ACK to a `set_interval` of ours; older firmware does not say to whom it answers."""
    if (acks := messages.get("COMMAND_ACK")) is None:
        return []
    mine = np.isin(acks["target_system"], (0, own_sysid)) & (acks["command"] == SET_MESSAGE_INTERVAL)
    return [int(result) for result in acks["result"][mine]]


def intervals(messages: Mapping[str, Messages]) -> list[tuple[int, int]]:
    """Message id and interval, µs, of each MESSAGE_INTERVAL."""
    if (answers := messages.get("MESSAGE_INTERVAL")) is None:
        return []
    return list(zip(answers["message_id"].tolist(), answers["interval_us"].tolist(), strict=True))


def _command(target: Target, command: int, *parameters: float) -> Request:
    numbered = {f"param{i}": float(value) for i, value in enumerate(parameters, 1)}
    return Request("COMMAND_LONG", _to(target) | {"command": command} | numbered)


def _to(target: Target) -> dict[str, Value]:
    return {"target_system": target.sysid, "target_component": target.compid}
