"""Answers that are remembered: many tests ask the same of the same flight, and the analysis is a pure function."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import io
import os
import pickle
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from companion.telemetry.lazy import LazyTuple

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


class _Written(pickle.Pickler):
    """Without what an object has cached of itself: whether somebody has looked at it is no part of a question."""

    def reducer_override(self, thing: object) -> Any:
        if isinstance(thing, LazyTuple):
            return tuple, (tuple(thing),)
        if dataclasses.is_dataclass(thing) and not isinstance(thing, type) and _caches(type(thing)):
            return _made, (type(thing), {field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)})
        return NotImplemented


@functools.cache
def _caches(kind: type) -> bool:
    return any(isinstance(member, functools.cached_property) for member in vars(kind).values())


def _made(kind: type, fields: dict[str, Any]) -> object:
    made: object = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def remembering(pure: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """The same function, which answers what it was asked before from a folder that other processes may share.

    Every bit of the question counts.
    """

    @functools.wraps(pure)
    def ask(*args: Any, **named: Any) -> Any:
        question = _written((pure.__qualname__, args, sorted(named.items())))
        known = folder / hashlib.sha256(question).hexdigest()
        with _alone(known.with_suffix(".asked")):
            if known.exists():
                return pickle.loads(known.read_bytes())
            answer = pure(*args, **named)
            begun = known.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
            begun.write_bytes(_written(answer))
            begun.replace(known)
            return answer

    return ask


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Whoever asks the same meanwhile waits for the answer instead of looking for it too; not on Windows."""
    with path.open("wb") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _written(thing: object) -> bytes:
    out = io.BytesIO()
    _Written(out, protocol=5).dump(thing)
    return out.getvalue()
