"""The backbone mesh of a robot: nodes at disks, loads and patches, stiffness of every element."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, add_residual_flexibility
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.material import SuperelasticSection
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot

#: How much stiffer a rigid insert is than the backbone: axial and shear, torsion and bending. Stiff enough that
#: the insert bends a hundred-thousandth as much, soft enough that round-off does not become force.
INSERT_FACTORS = np.array([1e2, 1e2, 1e2, 1e5, 1e5, 1e5])
#: Elements along the backbone that ``elements_per_bay = "auto"`` starts from, and the most in one bay.
STARTING_ELEMENTS, MOST_STARTING_PER_BAY = 20, 8
#: Largest relative change of the radius within an element of it, and the most elements in a bay for its sake [1]: the
#: error of a section that is constant in an element is of order 2, and in a scene nothing refines the mesh.
TAPER, MOST_TAPERED_PER_BAY = 0.012, 32


def elements_of_bays(robot: Robot, model: Model) -> tuple[int, ...]:
    """Elements of every bay, the stretch beyond the last disk included, shape (disks + 1,).

    With "auto" the first mesh follows from geometry: elements about a twentieth of the backbone long, and at most eight
    in a bay. The paper's robot with 13 disks has two a bay, and an error of 3e-5 of the length at 98 degrees.

    Raises
    ------
    ValueError
        Not one number per bay, or a number below 1.
    """
    given, length = model.elements_per_bay, robot.backbone.length
    edges = np.array([0.0, *robot.bay_ends, length])
    bays = len(edges) - 1
    if given == "auto":
        wanted = np.ceil(np.diff(edges) * STARTING_ELEMENTS / length - 1e-6)
        wanted = np.clip(wanted, 1, MOST_STARTING_PER_BAY)
        if robot.backbone.taper:
            change = np.abs(np.diff(np.log(robot.backbone.radius_at(edges))))
            wanted = np.maximum(wanted, np.minimum(np.ceil(change / TAPER), MOST_TAPERED_PER_BAY))
        return tuple(int(n) for n in wanted)
    counts = given if isinstance(given, tuple) else (int(given),) * bays
    if len(counts) != bays or min(counts) < 1:
        raise ValueError(
            f'elements_per_bay {given}; must be "auto", a number of 1 or more, or {bays} such numbers: one for every '
            "bay from the base plate on and one for the stretch beyond the last disk"
        )
    return counts


def hinge_length(length: float) -> float:
    """Length of the element that stands for a base that gives way, on a backbone of a length [m]."""
    return 1e-5 * length


def of_backbone(mesh: BackboneMesh) -> Flags:
    """Whether each element is one of the backbone; the first one may stand for a base that gives way."""
    found = np.ones(len(mesh.lengths), dtype=bool)
    found[0] = mesh.lengths[0] > 1.5 * hinge_length(float(mesh.arc_lengths[-1]))
    return found


def subdivide(robot: Robot, counts: Sequence[int], extra: Sequence[float]) -> tuple[Array, Flags]:
    """Arc lengths of nodes [m], shape (N,), and which elements are rigid inserts, shape (N-1,).

    Parameters
    ----------
    robot
        Description.
    counts
        Elements between neighbouring disks (between their faces where they are thick), for every bay, the stretch
        beyond the last disk included.
    extra
        Further arc lengths that need a node, such as those of loads [m].
    """
    length, half = robot.backbone.length, 0.5 * robot.disks.thickness
    near = 1e-9  # nodes closer than this are one [m]

    def in_disks(s: Array) -> Flags:
        middle = 0.5 * (s[1:] + s[:-1])
        return np.any(np.abs(middle[:, None] - robot.disks.positions) < half, axis=1)

    faces = [x for s in robot.bay_ends for x in (max(s - half, 0.0), s, min(s + half, length))]
    bounds = np.array([0.0, *faces, length])
    bounds = bounds[np.concatenate(([True], np.diff(bounds) > near))]
    nodes: list[float] = [0.0]
    for (a, b), rigid in zip(pairwise(bounds), in_disks(bounds), strict=True):
        parts = 1 if rigid else counts[bisect_left(robot.bay_ends, 0.5 * (a + b))]
        nodes += [float(a + (b - a) * i / parts) for i in range(1, parts + 1)]
    for s in extra:
        if min(abs(s - x) for x in nodes) > near:
            nodes.append(float(s))
    arc = np.array(sorted(nodes))
    return arc, in_disks(arc)


def build_mesh(robot: Robot, model: Model, extra: Iterable[float] = ()) -> tuple[BackboneMesh, Flags]:
    """Mesh of a robot's backbone, and which elements are rigid inserts.

    Parameters
    ----------
    robot, model
        Description and number of elements per bay.
    extra
        Arc lengths of further nodes [m].

    Returns
    -------
    mesh : BackboneMesh
    rigid : ndarray of bool, shape (N-1,)
        Which elements are rigid inserts inside thick disks.
    """
    b = robot.backbone
    edges = [x for p in b.patches for x in (p.start, p.end) if 0.0 < x < b.length]
    edges += [s for s, _ in b.taper if 0.0 < s < b.length]
    edges += [spring.at for spring in robot.springs]
    if robot.without_disks:
        edges += [robot.end(t) for t in robot.tendons]
    if robot.base_stiffness is not None:
        edges.append(hinge_length(b.length))
    arc, rigid = subdivide(robot, elements_of_bays(robot, model), [*extra, *edges])
    middle = 0.5 * (arc[1:] + arc[:-1])
    bending, torsion = b.stiffness_factors(middle)
    one = np.ones_like(middle)
    if b.taper:
        thick, one = b.taper_factors(arc)
        bending, torsion = bending * thick, torsion * thick
    modulus, density = b.material_factors(middle)
    along = one * modulus
    axial, shear, twist, bend = b.EA * along, b.GA * along, b.GJ * torsion, b.EI * bending
    stiffness = np.stack((axial, shear, shear, twist, bend, bend), axis=1)
    stiffness[rigid] *= INSERT_FACTORS
    if robot.base_stiffness is not None:
        # A very short element of this rotational stiffness; as a rigid insert, it does not creep and has no error.
        stiffness[0, 4:], rigid[0] = robot.base_stiffness * arc[1], True
    add_residual_flexibility(stiffness, np.diff(arc))
    # Rotary inertia grows with the fourth power of the radius, the square of the area.
    rotary = b.density * b.second_moment * (one**2 * density)[:, None] * np.array([2.0, 1.0, 1.0])
    unloaded = np.column_stack((b.unloaded_curvature(middle), np.zeros_like(middle)))
    precurvature = unloaded @ BEAM_TO_SECTION
    taper = np.diff(b.radius_at(arc)) / (np.diff(arc) * b.radius_at(middle))
    return BackboneMesh(arc, stiffness, b.mass_per_length * one * density, rotary, precurvature, taper), rigid


def softened(forces: ForceModel, mesh: BackboneMesh, rigid: Flags, factor: float) -> ForceModel:
    """The force model of a backbone that has crept; rigid inserts stay as they are.

    Parameters
    ----------
    forces
        Section forces of the same backbone, crept or not.
    mesh, rigid
        Before it crept.
    factor
        On the compliance in bending and torsion [1].
    """
    section = forces.section
    if section is not None and isinstance(section.material, SuperelasticSection):
        bending = np.where(rigid, 0.0, mesh.stiffness[:, 5] / factor)
        section = replace(section, material=replace(section.material, bending_stiffness=bending))
    softer = mesh.stiffness.copy()
    # The bending flexibility within the shear grows by the same factor.
    add_residual_flexibility(softer, mesh.lengths, factor - 1.0)
    softer[:, 3:] /= factor
    softer[rigid] = mesh.stiffness[rigid]
    return replace(forces, mesh=replace(mesh, stiffness=softer), section=section)
