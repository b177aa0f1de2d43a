"""Laws of the vehicles: closed, facing outward, the right way up, and with a front."""

from __future__ import annotations

import numpy as np
import pytest

from companion.view.scene.vehicle_shapes import Drone, Mesh, drone_for

TYPES = [
    "TRICOPTER",
    "QUADROTOR",
    "HEXAROTOR",
    "OCTOROTOR",
    "DODECAROTOR",
    "FIXED_WING",
    "VTOL_TILTROTOR",
    "HELICOPTER",
    "GROUND_ROVER",
    "SURFACE_BOAT",
    "SUBMARINE",
    "GIMBAL",  # has no shape of its own
]


@pytest.fixture(params=TYPES)
def drone(request: pytest.FixtureRequest) -> Drone:
    return drone_for(request.param)


def volume(mesh: Mesh) -> float:
    """Signed, by the divergence theorem: positive when every triangle faces outward."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def solids(mesh: Mesh) -> list[Mesh]:
    """The closed parts that a mesh is made of, told by their shared vertices."""
    part = np.arange(len(mesh.vertices))
    while True:
        lowest = part[mesh.faces].min(axis=1)
        joined = part.copy()
        np.minimum.at(joined, mesh.faces.ravel(), np.repeat(lowest, 3))
        if (joined == part).all():
            break
        part = joined
    owner = part[mesh.faces[:, 0]]
    return [Mesh(mesh.vertices, mesh.faces[owner == own]) for own in np.unique(owner)]


def test_every_part_is_closed_finite_and_faces_outward(drone: Drone) -> None:
    for mesh in (drone.body, drone.front):
        assert np.isfinite(mesh.vertices).all()
        assert mesh.faces.max() < len(mesh.vertices)
        edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
        there, back = {tuple(e) for e in edges.tolist()}, {tuple(e[::-1]) for e in edges.tolist()}
        assert there == back  # every edge is walked once each way: no holes, one orientation
        assert all(volume(solid) > 0 for solid in solids(mesh))


def test_the_front_is_in_front(drone: Drone) -> None:
    assert drone.front.vertices[:, 0].min() > 0
    assert drone.front.vertices[:, 0].max() > drone.body.vertices[:, 0].mean()
    assert volume(drone.front) > 0.01 * volume(drone.body)  # large enough to be seen


def test_left_and_right_are_alike(drone: Drone) -> None:
    for mesh in (drone.body, drone.front):
        assert mesh.vertices[:, 1].min() == pytest.approx(-mesh.vertices[:, 1].max())


def test_about_one_unit_around_the_imu_and_few_triangles(drone: Drone) -> None:
    points = np.concatenate([drone.body.vertices, drone.front.vertices])
    low, high = points.min(axis=0), points.max(axis=0)
    assert 0.8 < (high - low)[:2].max() < 1.5
    assert (low[:2] < 0).all()
    assert (high[:2] > 0).all()
    assert len(drone.body.faces) + len(drone.front.faces) < 2000  # software WebGL draws four of them
    assert 0.3 < drone.span_m < 3.0


@pytest.mark.parametrize("kind", ["QUADROTOR", "HEXAROTOR", "OCTOROTOR", "TRICOPTER", "HELICOPTER", "GROUND_ROVER"])
def test_what_stands_on_the_ground_has_its_feet_down(kind: str) -> None:
    depth = np.concatenate([drone_for(kind).body.vertices, drone_for(kind).front.vertices])[:, 2]
    assert depth.max() > 0.19  # FRD: down is positive


@pytest.mark.parametrize(("kind", "rotors"), [("TRICOPTER", 3), ("QUADROTOR", 4), ("HEXAROTOR", 6), ("OCTOROTOR", 8)])
def test_rotors_do_not_touch(kind: str, rotors: int) -> None:
    drone = drone_for(kind)
    discs = [s for mesh in (drone.body, drone.front) for s in solids(mesh) if len(s.faces) == 96]
    assert len(discs) == rotors
    corners = [np.unique(disc.faces) for disc in discs]
    middles = np.array([disc.vertices[c].mean(axis=0) for disc, c in zip(discs, corners, strict=True)])
    radius = max(
        float(np.linalg.norm((disc.vertices[c] - m)[:, :2], axis=1).max())
        for disc, c, m in zip(discs, corners, middles, strict=True)
    )
    apart = np.linalg.norm(middles[:, None] - middles[None], axis=2)
    assert apart[~np.eye(rotors, dtype=bool)].min() > 2 * radius


def test_a_plane_is_not_a_quadrotor() -> None:
    shapes = [drone_for(kind) for kind in TYPES]
    assert len({(len(s.body.faces), s.body.vertices.tobytes()) for s in shapes}) == len(TYPES)
