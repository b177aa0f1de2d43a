"""Read PX4's on-board logs (ULog, .ulg) as columns, by the definitions that each log carries itself.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html, and PX4 `src/modules/logger`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from companion.logs.logfile import MOST_BYTES, Contents, LogFile, Mapped, log_format, read_head
from companion.logs.ulog_messages import Dropout, Flags, Info, LoggedText, Parameter, Value, parsed_message
from companion.logs.ulog_scan import Scan
from companion.logs.ulog_topics import Collector, UlogTopic
from companion.model import InputError

_HEAD_BYTES = 16  # magic, version and when the log was begun
_APPENDED = 1  # the only incompatible flag that is known
_FLAGS = ord("B")


@dataclass(frozen=True, slots=True, eq=False)
class Ulog(LogFile):
    """An on-board log of PX4 in memory, as columns per topic and instance. Times are µs of the boot clock."""

    begun: int  # when the file says that it was begun
    cut_bytes: int  # of a message at the end that is not all there
    appended: bool  # data was added after the log had ended, as after a crash
    undecoded: Mapping[str, int]  # topic, "" for one of no name → messages whose declaration is missing or damaged
    unknown: int  # messages of a type that is not known, or whose content is damaged
    topics: tuple[UlogTopic, ...]  # by name and instance
    infos: Mapping[str, Value]
    parameters: Mapping[str, Value]  # at the beginning
    parameter_changes: tuple[tuple[int, str, Value], ...]  # (time, name, value)
    texts: tuple[LoggedText, ...]
    dropouts: tuple[tuple[int, float], ...]  # (time, duration in s) of what the logger could not keep up with
    kind: str = "ulog"


def read_ulog(
    path: str | Path,
    *,
    names: Collection[str] | None = None,
    progress: Callable[[int], None] | None = None,
    most_bytes: int = MOST_BYTES,
) -> Ulog:
    """Read an on-board log of PX4, as far as it can be read.

    `names`: the topics whose fields are requested (None: all); of the others only the times are kept. `progress` gets
    the bytes of each part that was looked through.

    Raises InputError if the file cannot be opened, has no data in it, or is of a kind that PX4 marks as incompatible.
    """
    path = Path(path)
    head = read_head(path)
    if log_format(path) != "ulog":
        raise InputError(
            f"{path} is no PX4 ULog: it begins with {head[:8].hex(' ').upper()}, not 55 4C 6F 67. "
            "Name the .ulg file that the autopilot wrote."
        )
    contents = Contents(path, most_bytes)
    mapped = Mapped(contents, progress)
    flags = _flags(path, head)
    collector = Collector(names)
    collector.latest = begun = int.from_bytes(head[8:_HEAD_BYTES], "little")
    scan = Scan(mapped.data, collector)
    size = len(mapped.data)
    edges = sorted({at for at in flags.appended if _HEAD_BYTES < at < size})
    for begin, end in zip([_HEAD_BYTES, *edges], [*edges, size], strict=True):
        scan.read(begin, end, mapped.looked_through)
    topics, undecoded = collector.topics()
    for number, count in scan.undeclared.items():
        name = collector.undeclared.get(number, "")
        undecoded[name] = undecoded.get(name, 0) + count
    if not topics:
        raise InputError(_no_data(path, collector))
    said = scan.other_messages  # what is said twice holds as it was said last
    set_values = [(t, m.name, m.value) for t, m in said if isinstance(m, Parameter)]
    return Ulog(
        path=path,
        size_bytes=contents.size_bytes,
        content_bytes=size,
        trouble=contents.trouble,
        begun=begun,
        frames=scan.messages,
        skipped_bytes=scan.skipped_bytes,
        cut_bytes=scan.cut_bytes,
        appended=bool(edges),
        undecoded=MappingProxyType(undecoded),
        unknown=scan.unknown,
        topics=topics,
        infos=MappingProxyType({m.name: m.value for _, m in said if isinstance(m, Info)}),
        parameters=MappingProxyType({name: value for t, name, value in set_values if t is None}),
        parameter_changes=tuple((t, name, value) for t, name, value in set_values if t is not None),
        texts=tuple(m for _, m in said if isinstance(m, LoggedText)),
        dropouts=tuple((t or 0, m.duration_ms * 1e-3) for t, m in said if isinstance(m, Dropout)),
    )


def _flags(path: Path, head: bytes) -> Flags:
    """The flags, which are the first message where there are any.

    Raises InputError for those that mean that this program cannot understand the rest.
    """
    size = int.from_bytes(head[_HEAD_BYTES : _HEAD_BYTES + 2], "little")
    body = head[_HEAD_BYTES + 3 : _HEAD_BYTES + 3 + size]
    message = parsed_message(_FLAGS, body) if head[_HEAD_BYTES + 2 : _HEAD_BYTES + 3] == b"B" else None
    flags = message if isinstance(message, Flags) else Flags(bytes(8), ())
    if flags.incompatible[0] & ~_APPENDED or any(flags.incompatible[1:]):
        raise InputError(
            f"{path} is a PX4 ULog with the incompatible flags {flags.incompatible.hex(' ').upper()}, of which only 01 "
            "is known: it is of a newer format, or its head is damaged. Copy it again, or update this program."
        )
    return flags if flags.incompatible[0] else Flags(bytes(8), ())


def _no_data(path: Path, collector: Collector) -> str:
    too_large = next(collector.formats.too_large(), None)
    if too_large is not None:
        return (
            f"{path} begins like a PX4 ULog, but declares {too_large!r} with more bytes than a message can have: its "
            "definitions are damaged. Copy it again."
        )
    return (
        f"{path} begins like a PX4 ULog, but no data can be read from it: it was cut off, or its definitions are "
        "damaged. Copy it again."
    )
