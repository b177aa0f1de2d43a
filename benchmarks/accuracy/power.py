"""The power curve as a table: of each fault and size, how often it was found, on the right side, and how late."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

import numpy as np

_ENOUGH = 0.95
_TWO_SIDED = 1.96  # σ of 95 % of a normal distribution
_OTHERS = ("wrong", "missed", "misled nobody", "cannot tell", "early", "failed")


class Row(Protocol):
    """What is read of a row."""

    @property
    def vehicle(self) -> str: ...
    @property
    def rate(self) -> str: ...
    @property
    def fault(self) -> str: ...
    @property
    def size(self) -> float: ...
    @property
    def result(self) -> str: ...
    @property
    def cause_right(self) -> bool: ...
    @property
    def delay_s(self) -> float | None: ...


def share(rows: Sequence[Row], result: str) -> float:
    """How often a result came up: the mean over vehicles of the mean over each one's flights."""
    by_vehicle: dict[str, list[bool]] = defaultdict(list)
    for row in rows:
        by_vehicle[row.vehicle].append(row.result == result)
    return float(np.mean([np.mean(results) for results in by_vehicle.values()]))


def smallest_found(shares: Iterable[tuple[float, float]]) -> float | None:
    """The smallest size from which on at least 95 % are found; pairs of size and share."""
    smallest = None
    for size, part in sorted(shares, reverse=True):
        if part < _ENOUGH:
            break
        smallest = size
    return smallest


def table(rows: Sequence[Row], units: Mapping[str, str]) -> str:
    """Everything as Markdown: first the untouched flights, then each fault of `units` (name → unit of its sizes)."""
    lines: list[str] = []
    for rate in sorted({row.rate for row in rows}, reverse=True):
        own = [row for row in rows if row.rate == rate]
        vehicles = len({row.vehicle for row in own})
        lines += [f"### IMU at {'its full rate' if rate == 'full' else rate}: {vehicles} vehicles", ""]
        lines += ["| untouched flights | flights | false alarm | cannot tell |", "|---|---|---|---|"]
        for name in sorted({row.fault for row in own} - units.keys()):
            these = [row for row in own if row.fault == name]
            shares = " | ".join(_percent(share(these, result)) for result in ("false alarm", "cannot tell"))
            lines.append(f"| {name} | {len(these)} | {shares} |")
        lines += [
            "",
            f"| fault | found, by size | found in 95 % from | {' | '.join(_OTHERS)} | cause right | delay, s |",
        ]
        lines += ["|---" * (5 + len(_OTHERS)) + "|"]
        for name in units:
            these = [row for row in own if row.fault == name]
            lines += [_of_fault(name, these, units[name])] if these else []
        lines.append("")
    return "\n".join(lines)


def detectable_table(rows: Sequence[Row], units: Mapping[str, str]) -> str:
    """By kind, of faults of the size that 95 % are to be found of: the share that was, and what became of the others.

    The interval is Wilson's, of 95 %.
    """
    lines = [f"| fault, at the size that is stated | faults | median size | found | interval | {' | '.join(_OTHERS)} |"]
    lines += ["|---" * (5 + len(_OTHERS)) + "|"]
    for name in units:
        own = [row for row in rows if row.fault == name]
        if not own:
            continue
        found = sum(row.result == "found" for row in own)
        low, high = wilson(found, len(own))
        size = f"{np.median([row.size for row in own]):.2g} {units[name]}"
        others = " | ".join(str(sum(row.result == result for row in own) or "") for result in _OTHERS)
        lines.append(f"| {name} | {len(own)} | {size} | {found / len(own):.0%} | {low:.0%} to {high:.0%} | {others} |")
    return "\n".join(lines)


def wilson(found: int, count: int) -> tuple[float, float]:
    """The 95 % interval of a share, of which `found` of `count` were seen (E. B. Wilson 1927)."""
    z2 = _TWO_SIDED**2
    middle = (found + 0.5 * z2) / (count + z2)
    half = _TWO_SIDED / (count + z2) * np.sqrt(found * (count - found) / count + 0.25 * z2)
    return max(middle - float(half), 0.0), min(middle + float(half), 1.0)


def _of_fault(name: str, rows: Sequence[Row], unit: str) -> str:
    """One line: what was found by size; the rest over all sizes."""
    sizes = sorted({row.size for row in rows})
    curve = [(size, share([row for row in rows if row.size == size], "found")) for size in sizes]
    by_size = ", ".join(f"{size:g}: {part:.0%}" for size, part in curve)
    smallest = smallest_found(curve)
    others = " | ".join(_percent(share(rows, result)) for result in _OTHERS)
    hits = [row for row in rows if row.result == "found"]
    right = _percent(float(np.mean([row.cause_right for row in hits]))) if hits else ""
    delays = [row.delay_s for row in hits if row.delay_s is not None]
    late = f"{np.median(delays):.1f}" if delays else ""
    enough = "—" if smallest is None else f"{smallest:g} {unit}"
    label = f"{name}, {unit}" if unit else name
    return f"| {label} | {by_size} | {enough} | {others} | {right} | {late} |"


def _percent(part: float) -> str:
    return f"{part:.0%}" if part else ""
