"""A boot's MAVLink messages → the series of its sensors, by the rows of `sources`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from companion.mavlink import Messages
from companion.model import Series
from companion.telemetry.quantities import Raw, RawSeries, raw_series, series_of
from companion.telemetry.sources import MESSAGE_SOURCES, VIBRATION_PX4, Source

SENSOR_MESSAGES = frozenset(row.name for row in MESSAGE_SOURCES)
"""Messages that become series."""


def message_sensors(messages: Mapping[str, Messages], notes: list[str], *, px4: bool) -> Mapping[str, Series]:
    """The series in a boot's messages, at their boot times. px4: the autopilot is one.

    What is left out is added to the notes.
    """
    return series_of(
        one
        for row in MESSAGE_SOURCES
        if row.name in messages
        for one in _of_messages(
            replace(row, fields=VIBRATION_PX4) if px4 and row.kind == "vibration" else row,
            messages[row.name],
            notes,
        )
    )


def _of_messages(row: Source, messages: Messages, notes: list[str]) -> Iterator[RawSeries | None]:
    """Of each sensor that the message tells apart."""
    if not row.by or not len(messages):
        yield _raw_series(row, messages, None, notes)
        return
    ids = np.column_stack([messages[name] for name in row.by])
    sensors = np.unique(ids, axis=0)
    for number, own in enumerate(sensors):
        several = number if len(sensors) > 1 else None
        yield _raw_series(row, messages.select(np.asarray((ids == own).all(axis=1))), several, notes)


def _raw_series(row: Source, messages: Messages, number: int | None, notes: list[str]) -> RawSeries | None:
    def column(field: str) -> Raw | None:
        name, _, place = field.partition("[")
        if name not in messages.layout.fields:
            return None
        return messages[name][:, int(place[:-1])] if place else messages[name]

    name = messages.name if number is None else f"{messages.name}[{number}]"
    instance = row.instance + (number or 0)
    return raw_series(row, name, messages.t, column, messages.layout.units, instance=instance, notes=notes)
