"""Draw a random robot, its size and friction in the range of real ones."""

from __future__ import annotations

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, PointsRouting, Routing
from tdcr_fe.model.tendon import Tendon


def draw_robot(kind: str, rng: np.random.Generator) -> Robot:
    """A robot of a kind of `tdcr_fe.validation.blind.recipes.ROBOTS`, its size drawn.

    Parameters
    ----------
    kind
        One tendon, three of one routing, or two segments.
    rng
        Draws length 0.15 to 0.4 m, 8 to 16 disks, the stiffness, offsets and friction 0.05 to 0.3.
    """
    length = round(float(rng.uniform(0.15, 0.4)), 3)
    radius = round(float(rng.uniform(0.35e-3, 0.6e-3)), 5)
    backbone = Backbone(length, radius, float(round(rng.uniform(50.0, 90.0)) * 1e9), 0.3, 6450.0)
    count = int(rng.integers(8, 17))
    if kind == "two-segment":
        count += count % 2
    disks = Disks.equally_spaced(count, length, mass=round(float(rng.uniform(1e-4, 5e-4)), 5), radius=7e-3)
    mu = round(float(rng.uniform(0.05, 0.3)), 3)
    offset = round(float(rng.uniform(3.5e-3, 6e-3)), 4)
    first = float(rng.integers(0, 12) * 10)
    angles = [first] if kind == "single" else [first + 120.0 * k for k in range(3)]
    if kind == "two-segment":
        return Robot(backbone, disks, _two_segments(disks, offset, angles, mu), name=kind)
    routing = str(rng.choice(["parallel", "helical", "converging", "points"])) if kind == "single" else kind
    routes = _draw_routes(routing, offset, angles, length, (0.0, *disks.positions), rng)
    tendons = tuple(Tendon(f"t{k + 1}", route, mu) for k, route in enumerate(routes))
    return Robot(backbone, disks, tendons, name=f"{len(tendons)} {routing}")


def _two_segments(disks: Disks, offset: float, angles: list[float], mu: float) -> tuple[Tendon, ...]:
    """Tendons a1, a2, ... up to the middle disk, and b1, b2, ... up to the tip, turned by 60 degrees."""
    middle = disks.positions[len(disks.positions) // 2 - 1]
    return (
        *(Tendon(f"a{k + 1}", ParallelRouting(offset, a), mu, end=middle) for k, a in enumerate(angles)),
        *(Tendon(f"b{k + 1}", ParallelRouting(offset, a + 60.0), mu) for k, a in enumerate(angles)),
    )


def _draw_routes(
    routing: str,
    offset: float,
    angles: list[float],
    length: float,
    holes_at: tuple[float, ...],
    rng: np.random.Generator,
) -> list[Routing]:
    """Routing at every angle [deg]. The same numbers are drawn for every kind of routing."""
    turns = round(float(rng.choice([-1, 1]) * rng.uniform(0.2, 0.6)), 2)
    end_offset = round(float(rng.uniform(0.35, 0.7)) * offset, 5)
    bulge = float(rng.uniform(0.1, 0.3))
    if routing == "parallel":
        return [ParallelRouting(offset, a) for a in angles]
    if routing == "helical":
        return [HelicalRouting(offset, turns, a) for a in angles]
    if routing == "converging":
        return [ConvergingRouting(offset, end_offset, a) for a in angles]
    return [_wavy_route(offset, a, bulge, length, holes_at) for a in angles]


def _wavy_route(
    offset: float, angle: float, bulge: float, length: float, holes_at: tuple[float, ...]
) -> PointsRouting:
    """Holes nearer to the backbone in the middle by a fraction ``bulge``, and swinging 0.4 rad to both sides."""
    size = [offset * (1.0 - bulge * np.sin(np.pi * s / length)) for s in holes_at]
    turn = [np.deg2rad(angle) + 0.4 * np.sin(2.0 * np.pi * s / length) for s in holes_at]
    holes = tuple(
        (round(float(r * np.cos(a)), 6), round(float(r * np.sin(a)), 6))
        for r, a in zip(size, turn, strict=True)
    )
    return PointsRouting(holes_at, holes)
