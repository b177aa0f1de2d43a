"""Vehicles as triangles, made in code: body axes FRD, about one unit long or wide, the IMU at the origin.

What points forward is a part of its own, in a lighter tint, so that a glance tells front from back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from companion.model import Array

Faces = npt.NDArray[np.uint32]
Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Closed convex parts; every triangle winds counter-clockwise seen from outside."""

    vertices: Array  # (V, 3) FRD, in units of the vehicle's span
    faces: Faces  # (F, 3)


def ring(centre: Array, axis: Array, radius: float, sides: int) -> Array:
    """`sides` points around `centre`, in the plane across `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u) / np.linalg.norm(axis)
    angles = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    return np.asarray(centre + radius * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)))


def hull(a: Array, b: Array) -> Mesh:
    """The convex body between two rings of equally many points, (n, 3) each."""
    n = len(a)
    vertices = np.concatenate([a, b, a.mean(axis=0)[None], b.mean(axis=0)[None]])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    sides = [np.stack([i, j, n + j], 1), np.stack([i, n + j, n + i], 1)]
    caps = [np.stack([i, j, np.full(n, 2 * n)], 1), np.stack([n + i, n + j, np.full(n, 2 * n + 1)], 1)]
    faces = np.concatenate(sides + caps)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = ((corners.mean(axis=1) - vertices.mean(axis=0)) * normals).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(vertices, faces.astype(np.uint32))


def box(low: Point, high: Point) -> Mesh:
    """From one corner to the opposite one."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return slab(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]), z0, z1)


def slab(outline: Array, top: float, bottom: float, scale: float = 1.0) -> Mesh:
    """A convex outline (n, 2) in the plane of forward and right, between two depths; `scale` narrows its bottom."""
    n = len(outline)
    under = outline.mean(axis=0) + scale * (outline - outline.mean(axis=0))
    return hull(np.column_stack([outline, np.full(n, top)]), np.column_stack([under, np.full(n, bottom)]))


def fin(outline: Array, thickness: float) -> Mesh:
    """A convex outline (n, 2) in the plane of forward and down, upright in the middle."""
    x, z = outline[:, 0], outline[:, 1]
    sides = [np.column_stack([x, np.full(len(x), s * thickness / 2), z]) for s in (-1, 1)]
    return hull(sides[0], sides[1])


def rod(start: Point, end: Point, radius: float, end_radius: float | None = None, sides: int = 6) -> Mesh:
    """A round bar, or a cone when its ends differ."""
    a, b = np.array(start), np.array(end)
    return hull(ring(a, b - a, radius, sides), ring(b, b - a, radius if end_radius is None else end_radius, sides))


def disc(centre: Point, radius: float, axis: Point = (0.0, 0.0, -0.02)) -> Mesh:
    """A round plate whose thickness is the length of `axis`."""
    c, a = np.array(centre), np.array(axis)
    return hull(ring(c, a, radius, 24), ring(c + a, a, radius, 24))


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Several solids as one mesh."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]).astype(np.uint32),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Drone:
    """A vehicle in two colours."""

    body: Mesh  # in the colour of its source
    front: Mesh  # in a light tint of it: what points forward
    span_m: float  # what one unit is in the world for a vehicle of common size


@cache
def drone_for(mav_type: str) -> Drone:
    """The shape for a MAV_TYPE (a name without its prefix). A type without a shape is a dart: it has a front."""
    if mav_type in _ROTORS:
        return multirotor(_ROTORS[mav_type])
    if mav_type.startswith("VTOL"):
        return quadplane()
    return _SHAPES.get(mav_type, dart)()


def multirotor(rotors: int) -> Drone:
    """An X multirotor with legs: the nose and the rotors ahead are the front part."""
    angles = np.radians(60.0) * np.array([1, 3, 5]) if rotors == 3 else np.pi * (2 * np.arange(rotors) + 1) / rotors
    radius = min(0.22, 0.46 * np.sin(np.pi / rotors))  # so that neighbours do not touch
    tips: list[Point] = [(0.5 * float(np.cos(a)), 0.5 * float(np.sin(a)), -0.03) for a in angles]
    ahead = [tip for tip in tips if tip[0] > radius - 0.05]
    body = [
        box((-0.17, -0.10, -0.06), (0.17, 0.10, 0.05)),
        *(rod((0.0, 0.0, 0.0), tip, 0.028) for tip in tips),
        *(rod((x, y, 0.02), (1.25 * x, 1.25 * y, 0.20), 0.014) for x in (-0.13, 0.13) for y in (-0.10, 0.10)),
        *(disc((x, y, -0.07), radius) for x, y, z in tips if (x, y, z) not in ahead),
    ]
    front = [
        rod((0.17, 0.0, -0.005), (0.40, 0.0, -0.005), 0.075, 0.004, sides=16),
        *(disc((x, y, -0.07), radius) for x, y, _ in ahead),
    ]
    return Drone(joined(body), joined(front), span_m=0.6 if rotors <= 4 else 0.9)


def plane() -> Drone:
    """A high-wing plane with a tail; the front part is its nose and propeller."""
    return Drone(joined(_airframe()), joined(_nose()), span_m=1.8)


def quadplane() -> Drone:
    """A plane with four rotors on booms."""
    sides, up = (-0.24, 0.24), (0.0, 0.0, -0.012)
    booms = [rod((-0.30, y, -0.02), (0.33, y, -0.02), 0.014) for y in sides]
    behind, ahead = ([disc((x, y, -0.05), 0.11, up) for y in sides] for x in (-0.24, 0.27))
    return Drone(joined([*_airframe(), *booms, *behind]), joined([*_nose(), *ahead]), span_m=2.0)


def helicopter() -> Drone:
    """A main rotor, a tail with a fin, and skids; the front part is its cabin."""
    body = [
        rod((-0.18, 0.0, 0.0), (0.05, 0.0, 0.0), 0.07, 0.12, sides=12),
        rod((-0.62, 0.0, -0.02), (-0.12, 0.0, 0.0), 0.018, 0.05),
        fin(np.array([(-0.62, 0.03), (-0.54, 0.03), (-0.60, -0.14), (-0.66, -0.14)]), 0.02),
        rod((0.0, 0.0, -0.10), (0.0, 0.0, -0.21), 0.02),
        box((-0.5, -0.03, -0.222), (0.5, 0.03, -0.21)),  # blades, not a disc: from above it would hide the rest
        box((-0.03, -0.5, -0.222), (0.03, 0.5, -0.21)),
        *(rod((-0.2, y, 0.21), (0.24, y, 0.21), 0.014) for y in (-0.11, 0.11)),
        *(rod((x, 0.4 * y, 0.08), (x, y, 0.21), 0.01) for x in (-0.1, 0.12) for y in (-0.11, 0.11)),
    ]
    return Drone(joined(body), joined([rod((0.05, 0.0, 0.0), (0.3, 0.0, 0.03), 0.12, 0.03, sides=12)]), span_m=1.5)


def rover() -> Drone:
    """Four wheels under a flat body; the front part is a wedge and the front wheels."""
    across: Point = (0.0, 0.10, 0.0)
    wheels = {x: [disc((x, y, 0.06), 0.15, across) for y in (-0.33, 0.23)] for x in (-0.3, 0.3)}
    body = [box((-0.45, -0.22, -0.08), (0.2, 0.22, 0.07)), box((-0.3, -0.14, -0.2), (0.05, 0.14, -0.08)), *wheels[-0.3]]
    side = np.array([(0.2, -0.08), (0.5, 0.0), (0.5, 0.07), (0.2, 0.07)])
    return Drone(joined(body), joined([fin(side, 0.44), *wheels[0.3]]), span_m=0.6)


def boat() -> Drone:
    """A hull with a cabin and a mast; the front part is its bow."""
    stern = np.array([(-0.5, -0.16), (0.1, -0.18), (0.1, 0.18), (-0.5, 0.16)])
    bow = np.array([(0.1, -0.18), (0.35, -0.11), (0.5, 0.0), (0.35, 0.11), (0.1, 0.18)])
    body = [
        slab(stern, -0.05, 0.12, scale=0.75),
        box((-0.3, -0.1, -0.2), (0.0, 0.1, -0.05)),
        rod((-0.15, 0.0, -0.2), (-0.15, 0.0, -0.45), 0.012),
    ]
    return Drone(joined(body), joined([slab(bow, -0.05, 0.1, scale=0.7)]), span_m=1.2)


def submarine() -> Drone:
    """A torpedo with four fins and a propeller; the front part is its dome."""
    tail = np.array([(-0.45, 0.05), (-0.3, 0.05), (-0.36, 0.26), (-0.45, 0.26)])
    body = [
        rod((-0.3, 0.0, 0.0), (0.25, 0.0, 0.0), 0.13, sides=16),
        rod((-0.5, 0.0, 0.0), (-0.3, 0.0, 0.0), 0.03, 0.13, sides=16),
        fin(tail, 0.02),
        fin(tail * (1, -1), 0.02),
        slab(tail, -0.01, 0.01),
        slab(tail * (1, -1), -0.01, 0.01),
        disc((-0.52, 0.0, 0.0), 0.12, (0.02, 0.0, 0.0)),
        box((-0.1, -0.03, -0.24), (0.06, 0.03, -0.12)),
    ]
    front = [
        rod((0.25, 0.0, 0.0), (0.38, 0.0, 0.0), 0.13, 0.1, sides=16),
        rod((0.38, 0.0, 0.0), (0.46, 0.0, 0.0), 0.1, 0.03, sides=16),
    ]
    return Drone(joined(body), joined(front), span_m=0.8)


def dart() -> Drone:
    """A paper plane, for what has no shape of its own; the front half is its front part."""
    behind = np.array([(-0.4, -0.32), (0.05, -0.14), (0.05, 0.14), (-0.4, 0.32)])
    ahead = np.array([(0.05, -0.14), (0.5, -0.01), (0.5, 0.01), (0.05, 0.14)])
    keel = np.array([(-0.4, 0.0), (0.05, 0.0), (-0.4, 0.16)])
    return Drone(joined([slab(behind, -0.03, 0.02), fin(keel, 0.03)]), joined([slab(ahead, -0.03, 0.02)]), 0.6)


def _airframe() -> list[Mesh]:
    wing = np.array([(-0.06, -0.5), (0.05, -0.5), (0.1, 0.0), (0.05, 0.5), (-0.06, 0.5)])
    tail = np.array([(-0.46, -0.17), (-0.38, -0.17), (-0.35, 0.0), (-0.38, 0.17), (-0.46, 0.17)])
    rudder = np.array([(-0.46, 0.0), (-0.34, 0.0), (-0.40, -0.17), (-0.47, -0.17)])
    return [
        rod((-0.46, 0.0, 0.0), (0.02, 0.0, 0.01), 0.025, 0.055, sides=12),
        rod((0.02, 0.0, 0.01), (0.22, 0.0, 0.01), 0.055, 0.055, sides=12),
        slab(wing, -0.065, -0.045),
        slab(tail, -0.02, -0.005),
        fin(rudder, 0.016),
    ]


def _nose() -> list[Mesh]:
    return [
        rod((0.22, 0.0, 0.01), (0.34, 0.0, 0.01), 0.055, 0.02, sides=12),
        disc((0.33, 0.0, 0.01), 0.14, (0.012, 0.0, 0.0)),
    ]


_ROTORS = {
    "TRICOPTER": 3,
    "QUADROTOR": 4,
    "COAXIAL": 4,
    "HEXAROTOR": 6,
    "OCTOROTOR": 8,
    "DECAROTOR": 10,
    "DODECAROTOR": 12,
    "GENERIC_MULTIROTOR": 4,
}
_SHAPES = {
    "FIXED_WING": plane,
    "FLAPPING_WING": plane,
    "KITE": plane,
    "PARAFOIL": plane,
    "HELICOPTER": helicopter,
    "GROUND_ROVER": rover,
    "SURFACE_BOAT": boat,
    "SUBMARINE": submarine,
}
