"""One colour per source, in the scene, the plots and the tables. From Okabe and Ito's colour-blind safe set."""

from __future__ import annotations

Rgb = tuple[int, int, int]

IMU: Rgb = (230, 97, 1)  # vermillion: what the IMU alone says
FREE: Rgb = (243, 170, 110)  # pale vermillion: the same IMU, left alone for longer
AUTOPILOT: Rgb = (0, 114, 178)  # blue: what the autopilot says
DIFFERENCE: Rgb = (204, 84, 152)  # reddish purple, a little deeper for thin lines: the error between both
HEADING: Rgb = (0, 158, 115)  # bluish green: the heading part of the attitude error
AXES: tuple[Rgb, Rgb, Rgb] = ((214, 145, 0), (0, 158, 115), (86, 180, 233))
"""Forward, right and down: amber, green and sky, none of them a source's colour."""
CURSOR: Rgb = (130, 130, 130)  # the current instant

CONTROLS: Rgb = (84, 96, 112)  # buttons: no source's colour


def css(colour: Rgb) -> str:
    """The colour as the browser writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def mix(colour: Rgb, other: Rgb, share: float) -> Rgb:
    """`colour` with a `share` (0 ... 1) of `other`."""
    r, g, b = (round(a + (c - a) * share) for a, c in zip(colour, other, strict=True))
    return r, g, b
