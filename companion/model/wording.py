"""Counts, identifiers and objects as text: in sentences, and in a notebook in at most five lines."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches

import numpy as np


def counted(count: int, noun: str) -> str:
    """1 window, 2 windows, 1,024 switches, 3 fixes."""
    plural = "" if count == 1 else "es" if noun.endswith(("ch", "x")) else "s"
    return f"{count:,} {noun}{plural}"


def nearest_word(word: str, known: Collection[str]) -> str:
    """The known word that a misspelt one was probably meant as; "" where none is near."""
    return next(iter(get_close_matches(word.lower(), known, n=1)), "")


def words(name: str) -> str:
    """An identifier as people write it."""
    return _SAID.get(name) or " ".join(_WRITTEN.get(word, word) for word in name.split("_"))


_WRITTEN = {"gps": "GPS", "imu": "IMU", "imus": "IMUs", "accel": "accelerometer"}
_SAID = {"insufficient_data": "cannot tell"}  # what the documents have called it since the first release


LINES, WIDTH = 5, 100
_FEW = 4  # numbers or names that are shown, and not counted
_LONGEST = 60  # characters of one value


def brief(self: object) -> str:
    """The fields of a dataclass, arrays as their shape and ends: for `__repr__ = brief` in the class.

    >>> import companion as c
    >>> c.open_log("tlogs/copter-demo-100hz.tlog")[0].attitude
    AttitudeTrack(t=(5061,) 62.54 ... 164, q_ned_frd=(5061, 4), rates=(5061, 3), source='ATTITUDE',
      rates_reported=True)
    """
    lines = [f"{type(self).__name__}("]
    names = [f.name for f in fields(self) if f.repr]  # type: ignore[arg-type]
    for i, name in enumerate(names, 1):
        part = f"{name}={_short(getattr(self, name))}" + (")" if i == len(names) else ", ")
        if len(lines[-1]) + len(part.rstrip()) <= WIDTH:
            lines[-1] += part
        elif len(lines) < LINES:
            lines.append(f"  {part}")
        else:
            lines[-1] += "...)"
            break
    return "\n".join(line.rstrip() for line in lines)


def _short(value: object) -> str:
    match value:
        case np.ndarray():
            return _array(value)
        case float():
            return f"{value:.6g}"
        case Mapping():
            return "{" + _names([str(key) for key in value]) + "}"
        case str():
            return repr(value if len(value) <= _LONGEST else value[: _LONGEST - 1] + "…")
        case Sequence():
            text = f"({', '.join(map(_short, value))})" if len(value) <= _FEW else ""
            return text if text and len(text) <= _LONGEST else f"[{len(value)}]"
        case _:
            text = repr(value)
            whole = len(text) <= _LONGEST and "\n" not in text
            return text if whole or not is_dataclass(value) else type(value).__name__


def _array(values: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> str:
    if values.size <= _FEW and values.dtype.kind in "fiu":
        return f"[{', '.join(f'{value:.4g}' for value in values.ravel().tolist())}]"
    shape = str(values.shape)
    ends = values.ndim == 1 and values.dtype.kind == "f"
    return f"{shape} {values[0]:.4g} ... {values[-1]:.4g}" if ends else shape


def _names(names: Sequence[str]) -> str:
    more = f", ... {len(names)} in all" if len(names) > _FEW else ""
    return ", ".join(names[:_FEW]) + more
