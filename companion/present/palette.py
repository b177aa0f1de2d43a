"""One colour per source, in the scene, the plots and the tables. From Okabe and Ito's colour-blind safe set."""

from __future__ import annotations

from collections.abc import Iterable

Rgb = tuple[int, int, int]

AUTOPILOT: Rgb = (0, 114, 178)  # blue: the autopilot's estimate
IMUS: tuple[Rgb, ...] = ((230, 97, 1), (0, 158, 115), (230, 180, 30), (86, 180, 233), (120, 90, 60))
"""Vermillion, bluish green, amber, sky, brown: the IMUs of a flight in its own order, whichever is integrated."""
IMU: Rgb = IMUS[0]  # the IMU where there is but one
BEST: Rgb = (60, 60, 60)  # near black: the best estimate, which belongs to neither
BEST_LIGHT: Rgb = (225, 225, 225)  # every other dash of it in the picture, whose background may be dark
GPS: Rgb = (120, 155, 70)  # moss green: the GPS receiver
FREE: Rgb = (243, 170, 110)  # pale vermillion: the same IMU, left alone for longer
HEADING: Rgb = (0, 158, 115)  # bluish green: a second quantity of the same source
DIFFERENCE: Rgb = (204, 84, 152)  # reddish purple, a little deeper for thin lines: what lies between both, and findings
AXES: tuple[Rgb, Rgb, Rgb] = ((170, 51, 119), (133, 133, 0), (68, 68, 170))
"""Forward, right and down: wine, olive and indigo, none of them a source's colour."""
CURSOR: Rgb = (130, 130, 130)  # the current instant, and what is expected

CONTROLS: Rgb = (84, 96, 112)  # buttons: no source's colour
BRAND: Rgb = (68, 78, 92)  # given to viser, which draws it 1.34 times as light on a light page
GOOD: Rgb = (26, 115, 60)
DOUBTFUL: Rgb = (133, 84, 0)
BAD: Rgb = (176, 32, 24)
"""Behind white words: a verdict that is good, undecided, bad."""

SIGNS = {"consistent": "✓", "imu_suspect": "✗", "autopilot_suspect": "✗", "insufficient_data": "?"}
"""Status of a verdict → its sign, for those who see no colours."""
SEVERITIES: dict[str, Rgb] = {"error": BAD, "warning": DOUBTFUL, "info": CONTROLS}
"""Of findings: behind white words too."""

QUIET = 0.7
"""Opacity of words that matter less."""
TROUBLE: Rgb = (176, 32, 24)
TROUBLE_ON_DARK: Rgb = (255, 138, 128)
"""Warnings on a panel."""
MODES: tuple[Rgb, Rgb] = ((120, 135, 190), (190, 165, 120))
MODES_OPACITY = 0.25
"""Behind the names of flight modes, over `BAND`; neighbours differ."""
BAND, BAND_OPACITY = CURSOR, 0.12
"""Behind all bands of the timeline."""

SIGMAS: tuple[tuple[float, Rgb], ...] = ((1.0, (139, 178, 208)), (2.0, (224, 164, 36)), (3.0, BAD))
"""Error in σ of what is allowed → colour of the autopilot's track: pale blue, amber, red, and mixed in between."""
UNKNOWN: Rgb = (175, 175, 175)
"""Where no error is known."""


def of_imus(names: Iterable[str]) -> dict[str, Rgb]:
    """The colour of each IMU message of a flight, in the flight's own order."""
    return {name: IMUS[i % len(IMUS)] for i, name in enumerate(names)}


def css(colour: Rgb) -> str:
    """The colour as the browser writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def rgba(colour: Rgb, opacity: float) -> str:
    """A colour that one can see through, as the browser writes it."""
    return f"rgba({','.join(map(str, colour))},{opacity})"


def mix(colour: Rgb, other: Rgb, share: float) -> Rgb:
    """`colour` with a `share` (0 ... 1) of `other`."""
    r, g, b = (round(a + (c - a) * share) for a, c in zip(colour, other, strict=True))
    return r, g, b
