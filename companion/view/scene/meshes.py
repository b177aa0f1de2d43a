"""Closed solids made of triangles, and putting them together. Lengths have no unit here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    outline = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    return slab(outline, z0, z1)


def slab(outline: Array, top: float, bottom: float, scale: float = 1.0) -> Mesh:
    """A convex outline (n, 2) in the plane of forward and right, between two depths; `scale` narrows its bottom."""
    n = len(outline)
    under = outline.mean(axis=0) + scale * (outline - outline.mean(axis=0))
    return hull(np.column_stack([outline, np.full(n, top)]), np.column_stack([under, np.full(n, bottom)]))


def fin(outline: Array, y: float, thickness: float) -> Mesh:
    """A convex outline (n, 2) in the plane of forward and down, upright at `y` to the right."""
    x, z = outline[:, 0], outline[:, 1]
    sides = [np.column_stack([x, np.full(len(x), y + s * thickness / 2), z]) for s in (-1, 1)]
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
