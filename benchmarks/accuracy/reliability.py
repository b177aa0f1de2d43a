"""Whether stated probabilities hold: of verdicts that are stated with a probability p, a share p has to be right."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

EDGES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Deciles, the last of them in parts: there an accusation begins."""

SURE, _FEW = 0.95, 0.9  # from which on somebody is accused; of a vehicle's, less than this share right is too few


class Claim(NamedTuple):
    """What a verdict states."""

    whose: str  # flight
    stated: float | None  # probability; None where it states none
    right: bool
    accuses: bool = True  # somebody; False: it says that nobody is wrong


def reliability(verdicts: Iterable[Claim]) -> str:
    """Stated probability against the share that was right, and by vehicle from 95 % on, as Markdown tables."""
    every = list(verdicts)
    stated = [(one.whose, one.stated, one.right) for one in every if one.stated is not None]
    lines = ["| stated | verdicts | mean stated | right |", "|---|---|---|---|"]
    for low, high in pairwise(EDGES):
        own = [(p, right) for _, p, right in stated if low <= p < high or p == high == EDGES[-1]]
        if own:
            mean, share = sum(p for p, _ in own) / len(own), sum(right for _, right in own) / len(own)
            lines.append(f"| {low:.2f}-{high:.2f} | {len(own)} | {mean:.3f} | {share:.3f} |")
    silent = [one.right for one in every if one.stated is None]
    if silent:
        lines.append(f"| none | {len(silent)} | | {sum(silent) / len(silent):.3f} |")
    sure: dict[str, list[bool]] = defaultdict(list)
    for whose, p, right in stated:
        if p >= SURE:
            sure[whose].append(right)
    lines += ["", f"| stated {SURE} or more, of | verdicts | right |", "|---|---|---|"]
    lines += [f"| {whose} | {len(own)} | {sum(own) / len(own):.3f} |" for whose, own in sorted(sure.items())]
    certain = [one for one in every if one.stated is not None and one.stated >= SURE]
    return "\n".join([*lines, "", _summary(sure) + _by_kind(certain)])


def _by_kind(certain: Sequence[Claim]) -> str:
    """Accusations apart from *nobody*, which no set tells of in which flights with a fault are as many as in this."""
    shares = (
        f"{name} {sum(own)} of {len(own)}"
        for name, accuses in (("accusations", True), ("nobody", False))
        if (own := [one.right for one in certain if one.accuses == accuses])
    )
    return f"; {', '.join(shares)}" if certain else ""


def _summary(sure: Mapping[str, Sequence[bool]]) -> str:
    """How many of the verdicts that are sure were right, by vehicle, and those of which too few were."""
    every = [right for own in sure.values() for right in own]
    if not every:
        return f"Verdicts stated >= {SURE}: none"
    low = [f"{whose} ({sum(own)} of {len(own)})" for whose, own in sorted(sure.items()) if sum(own) < _FEW * len(own)]
    return (
        f"Verdicts stated >= {SURE}: {len(every)}, right in {sum(every) / len(every):.1%}; "
        f"right in less than {_FEW:.0%}: {', '.join(low) or 'none'}"
    )
