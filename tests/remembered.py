"""Answers that are remembered: many tests have the same flight analysed, and the analysis is a pure function.

Between processes they are pickled. Where CI is "true" nothing is, and no process knows another's answers: a result that
a pickle changes cannot hide there (CONTRIBUTING.md). That the functions are pure has a test (test_same_numbers.py).
"""

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

from companion.telemetry.sources import LazyTuple

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


class _Written(pickle.Pickler):
    """Without what an object has cached of itself: it is no part of a question."""

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


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, called once for each first argument: a path, or an object that is told from others by identity."""
    known: dict[Any, Any] = {}

    def call(first: Any, *rest: Any, **more: Any) -> Any:
        key = first if isinstance(first, Path) else id(first)
        if key not in known:
            known[key] = function(first, *rest, **more)
        return known[key]

    return call


def within_a_process(pure: Callable[..., Any], most: int = 16) -> Callable[..., Any]:
    """The same function, which knows its latest answers; every bit of the arguments counts."""
    known: dict[bytes, Any] = {}

    @functools.wraps(pure)
    def call(*args: Any, **named: Any) -> Any:
        question = hashlib.sha256(_written((args, sorted(named.items())))).digest()
        known[question] = known.pop(question) if question in known else pure(*args, **named)  # the latest is last
        if len(known) > most:
            known.pop(next(iter(known)), None)
        return known.get(question)

    return call


def remembering(pure: Callable[..., Any], folder: Path) -> Callable[..., Any]:
    """The same function, which reads what it has answered before from a folder that other processes may share.

    Every bit of the arguments counts.
    """

    @functools.wraps(pure)
    def call(*args: Any, **named: Any) -> Any:
        question = _written((pure.__module__, pure.__qualname__, args, sorted(named.items())))
        known = folder / hashlib.sha256(question).hexdigest()
        with _alone(known.with_suffix(".lock")):
            if known.exists():
                return pickle.loads(known.read_bytes())
            answer = pure(*args, **named)
            begun = known.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
            begun.write_bytes(_written(answer))
            begun.replace(known)
            return answer

    return call


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """A second process with the same question waits for the answer; not on Windows."""
    with path.open("wb") as file:
        if fcntl is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _written(thing: object) -> bytes:
    out = io.BytesIO()
    _Written(out, protocol=5).dump(thing)
    return out.getvalue()
