"""Vehicles as triangles, made in code: body axes FRD, motors one unit apart across the diagonal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.tracks import Array

Faces = npt.NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Closed convex parts; every triangle winds counter-clockwise seen from outside."""

    vertices: Array  # (V, 3) FRD, in units of the vehicle's span
    faces: Faces  # (F, 3)


@dataclass(frozen=True, slots=True)
class Drone:
    """A vehicle in two colours, so that a glance tells front from back."""

    body: Mesh  # in the colour of its source
    front: Mesh  # in a light tint of it: what points forward
    span_m: float  # what one unit is in the world for a vehicle of common size


def quadrotor() -> Drone:
    """An X quadrotor: the nose and the two front rotors are the front part."""
    reach = 0.5 / np.sqrt(2)
    body = [
        _box((-0.17, -0.10, -0.06), (0.17, 0.10, 0.05)),
        *(_rod((0.0, 0.0, 0.0), (x, y, -0.03), 0.028) for x in (-reach, reach) for y in (-reach, reach)),
        *(_rod((x, y, 0.02), (1.25 * x, 1.25 * y, 0.20), 0.014) for x in (-0.13, 0.13) for y in (-0.10, 0.10)),
        *(_disc((-reach, y, -0.07), 0.22) for y in (-reach, reach)),
    ]
    front = [
        _cone((0.17, 0.0, -0.005), (0.40, 0.0, -0.005), 0.075),
        *(_disc((reach, y, -0.07), 0.22) for y in (-reach, reach)),
    ]
    return Drone(_joined(body), _joined(front), span_m=0.6)


def drone_for(mav_type: str) -> Drone:
    """The shape for a MAV_TYPE (a name without its prefix). So far everything is a quadrotor."""
    del mav_type  # planes, rovers, boats and submarines get their own shapes here
    return quadrotor()


def _ring(centre: Array, axis: Array, radius: float, sides: int) -> Array:
    """`sides` points around `centre`, in the plane across `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    v = np.cross(axis, u) / np.linalg.norm(axis)
    angles = (np.arange(sides) + 0.5) * 2 * np.pi / sides
    return np.asarray(centre + radius * (np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)))


def _hull(a: Array, b: Array) -> Mesh:
    """The convex body between two rings of equally many points."""
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


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    (x0, y0, z0), (x1, y1, z1) = low, high
    ring = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return _hull(
        np.column_stack([ring, np.full(4, z0)]),
        np.column_stack([ring, np.full(4, z1)]),
    )


def _rod(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Mesh:
    a, b = np.array(start), np.array(end)
    return _hull(_ring(a, b - a, radius, 6), _ring(b, b - a, radius, 6))


def _cone(base: tuple[float, float, float], tip: tuple[float, float, float], radius: float) -> Mesh:
    a, b = np.array(base), np.array(tip)
    return _hull(_ring(a, b - a, radius, 16), _ring(b, b - a, radius / 20, 16))


def _disc(centre: tuple[float, float, float], radius: float) -> Mesh:
    c, up = np.array(centre), np.array([0.0, 0.0, 0.02])
    return _hull(_ring(c, up, radius, 24), _ring(c - up, up, radius, 24))


def _joined(parts: list[Mesh]) -> Mesh:
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]).astype(np.uint32),
    )
