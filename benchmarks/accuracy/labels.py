"""Labels of recordings: which side was wrong in which flight, and what has to be said. The format: labels.toml."""

from __future__ import annotations

import fnmatch
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import msgspec

from benchmarks.accuracy.answer import Answer
from companion.model import InputError

Outcome = Literal["right", "cannot tell", "not shown", "false alarm", "inverted", "missed", "unread"]

SHARED = Path(__file__).resolve().parents[3] / "shared" / "tlogs"
RECORDINGS = (".tlog", ".bin", ".ulg", ".log", ".raw")
PACKED = (".xz", ".gz", ".zst", ".bz2")

_IN_TIME_S = 10.0
_TRUE_SIZE = 0.3  # how far off the size may be, as a share of it


class Label(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is known of one flight, or of every flight of a recording."""

    log: str
    truth: Literal["none", "imu", "autopilot", "none_judgeable", "no_flight"]
    flight: str = ""
    group: str = ""
    cause: tuple[str, ...] = ()
    sensor: str = ""
    axis: str = ""
    onset: float | None = None
    end: float | None = None
    size: float | None = None
    accept: tuple[str, ...] = ()
    hidden: dict[str, float] = {}
    what: str = ""

    def matches(self, log: str) -> bool:
        """Whether it speaks of a recording, whose path below the folder is `log`, packed or not."""
        return any(fnmatch.fnmatchcase(log, self.log + suffix) for suffix in ("", *PACKED))


class _Labels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    label: tuple[Label, ...]


def load_labels(path: Path) -> tuple[Label, ...]:
    """The labels of a file. Raises InputError when it cannot be read or says what no label can say."""
    try:
        with path.open("rb") as file:
            return msgspec.convert(tomllib.load(file), _Labels).label
    except (OSError, tomllib.TOMLDecodeError, msgspec.ValidationError) as error:
        raise InputError(f"{path} is no file of labels: {error}. See benchmarks/accuracy/labels.toml.") from error


def recordings(folder: Path) -> list[Path]:
    """Every recording below a folder."""

    def named(path: Path) -> str:
        name = path.name.lower()
        return next((name.removesuffix(suffix) for suffix in PACKED if name.endswith(suffix)), name)

    return sorted(path for path in folder.rglob("*") if path.is_file() and named(path).endswith(RECORDINGS))


def name_of(path: Path, folder: Path = SHARED) -> str:
    """A recording as labels name it: by its path below the folder; one that lies elsewhere by its name alone."""
    path, folder = path.resolve(), folder.resolve()
    return path.relative_to(folder).as_posix() if folder in path.parents else path.name


def outcome(label: Label, said: Answer | None) -> Outcome:
    """The verdict of a flight against its label. None: the flight, or the recording, was not read."""
    if label.truth == "no_flight":
        return "right" if said is None else "missed"
    if said is None:
        return "unread"
    right = {"none": "none", "imu": "imu", "autopilot": "autopilot", "none_judgeable": "cannot_tell"}[label.truth]
    if said.side == right:
        return "right"
    if said.side in label.accept or f"{said.side}:{said.cause}" in label.accept:
        return "cannot tell" if said.side == "cannot_tell" else "right"
    if said.side in {"imu", "autopilot"}:
        return "inverted" if label.truth in {"imu", "autopilot"} else "false alarm"
    return "not shown" if said.side == "none" and label.hidden and is_below(label.hidden, said) else "missed"


def is_below(sizes: Mapping[str, float], said: Answer) -> bool:
    """Whether the verdict says that it would not have shown these sizes, or that it did not judge them."""
    return all(said.smallest.get(quantity, float("inf")) > size for quantity, size in sizes.items())


def details(label: Label, said: Answer) -> dict[str, bool]:
    """Of a side that is named rightly: whether cause, sensor, axis, time and size are right, where the label has them.

    An axis or size that is not told is not right.
    """
    right: dict[str, bool] = {}
    if label.cause:
        right["cause"] = said.cause in label.cause
    if label.sensor:
        right["sensor"] = said.sensor == label.sensor
    if label.axis:
        right["axis"] = said.axis == label.axis
    if label.onset is not None:
        right["onset"] = said.onset is not None and abs(said.onset - label.onset) <= _IN_TIME_S
    if label.size is not None:
        right["size"] = said.size is not None and abs(said.size - label.size) <= _TRUE_SIZE * label.size
    return right
