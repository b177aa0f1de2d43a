"""`companion info --json` (docs/json.md)."""

from __future__ import annotations

from companion.analysis import inventory, phases
from companion.app.recording import Recording
from companion.documents.document import Document, document, flight_head, of
from companion.model import Flight, SensorInUse


def info_document(recording: Recording) -> Document:
    """What is in a log."""
    return document(
        recording.source,
        [_flight(flight) for flight in recording.flights],
        others=[of(other, "sysid", "compid", "reason") for other in recording.bystanders],
        crowd=recording.unread_senders,
        unknown_frames={str(number): count for number, count in recording.source.unknown_frames.items()},
    )


def _flight(flight: Flight) -> Document:
    return {
        **flight_head(flight),
        "start_s": flight.start,
        "duration_s": flight.duration,
        "default_imu": flight.default_imu,
        "reference": reference(flight),
        "notes": flight.notes,
        "phases": [
            {"kind": part.kind, "start_s": part.start, "end_s": part.end, "reason": part.reason}
            for part in phases(flight)
        ],
        "sensors": inventory(flight),
        "imu_in_use": None if flight.imu_in_use is None else _in_use(flight.imu_in_use),
        "aiding_in_use": {kind: _in_use(used) for kind, used in flight.aiding_in_use.items()},
        "resets": [{"t_s": reset.t, **of(reset, "kind", "text", "core")} for reset in flight.resets],
        "parameter_changes": [{"t_s": one.t, **of(one, "name", "value")} for one in flight.parameter_changes],
        "messages": flight.messages,
    }


def reference(flight: Flight) -> Document:
    """The messages that the autopilot's state is taken from."""
    tracks = {"attitude": flight.attitude, "position": flight.position}
    return {name: track.source if track else None for name, track in tracks.items()}


def _in_use(used: SensorInUse) -> list[Document]:
    return [{"t_s": t, "instance": i} for t, i in used.changes]
