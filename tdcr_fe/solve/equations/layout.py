"""What a scene consists of, and how its unknowns map to those of the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.solve.equations.band import BandLayout
from tdcr_fe.solve.equations.buckling import buckling_shortening
from tdcr_fe.solve.equations.configuration import ConfigurationSpace
from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.reduction import BodyFrameReduction, RobotNodes
from tdcr_fe.solve.equations.scales import ResidualScales


@dataclass(frozen=True, eq=False)
class SceneLayout:
    """Map from the unknowns of Exudyn's scene to those of the solver.

    Attributes
    ----------
    clamps : dict
        By robot whose base is clamped to ground, the numbers of the joint's multipliers.
    reduction : BodyFrameReduction
    space : ConfigurationSpace
    clamped : tuple of slice
        Unknowns of the clamped bases, in the order of ``clamps``.
    scales : ResidualScales
    turning : tuple of int
        Numbers of the loads that change with the configuration of the node they act on.
    user_loads : bool
        Whether functions of the user may change loads while a load step is solved.
    no_others : bool
        Whether no objects but the robots resist motion.
    band : BandLayout or None
        Order of the unknowns of a banded tangent, where it is that of one robot alone and is faster than a full one.
    buckling : tuple of ndarray, shape (E,)
        By robot, shortening of every element at which its bay buckles [m].
    numberings : dict of Numbering
        Those computed so far, by which tendons are driven by displacement.
    """

    clamps: dict[int, NDArray[np.int_]]
    reduction: BodyFrameReduction
    space: ConfigurationSpace
    clamped: tuple[slice, ...]
    scales: ResidualScales
    turning: tuple[int, ...]
    user_loads: bool
    no_others: bool
    band: BandLayout | None
    buckling: tuple[NDArray[np.float64], ...]
    numberings: dict[tuple[bytes, ...], Numbering] = field(default_factory=dict)

    @classmethod
    def of(cls, mbs: exu.MainSystem, robots: Sequence[TendonActuation], with_clamps: bool) -> SceneLayout:
        """Layout of an assembled scene; ``with_clamps=False`` treats the joints of clamped bases as any other."""
        data = mbs.systemData
        for robot in robots:
            robot.forget_coordinates()
            robot.disconnect()
        norms = [i for robot in robots for node in robot.nodes for i in data.GetNodeLTGAE(node)]
        clamps = _clamps(mbs, robots) if with_clamps else {}
        dropped = [*norms, *(i for joint in clamps.values() for i in joint)]
        coordinates = np.concatenate([r.coordinates for r in robots])
        items = [int(r.connectors.forces) for r in robots]
        reduction = BodyFrameReduction(mbs, coordinates, dropped, _rows_of_nodes(robots), items)
        space = ConfigurationSpace(mbs, robots, reduction, clamps)
        starts = [6 * space.slices[i].start for i in clamps]
        loads = [mbs.GetLoad(i) for i in range(data.NumberOfLoads())]
        # Forces fixed in the world have no derivative at a node; all other loads may have one.
        turning = tuple(i for i, load in enumerate(loads) if _turns(load))
        no_others = not len(reduction.other) and _nothing_but_robots(mbs, robots)
        return cls(
            clamps,
            reduction,
            space,
            tuple(slice(k, k + 6) for k in starts),
            ResidualScales.of(robots, reduction),
            turning,
            any(load.get("loadVectorUserFunction") or load.get("loadUserFunction") for load in loads),
            no_others,
            BandLayout.of(robots) if no_others else None,
            tuple(buckling_shortening(robot) for robot in robots),
        )


def _clamps(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> dict[int, NDArray[np.int_]]:
    """By robot whose base is clamped to ground, the numbers of the joint's multipliers."""
    found = {}
    for i, robot in enumerate(robots):
        if robot.clamp is None:
            continue
        joint = mbs.GetObject(robot.clamp.joint)
        if joint["activeConnector"] and all(joint["constrainedAxes"]) and not joint["offsetUserFunction"]:
            found[i] = np.array(mbs.systemData.GetObjectLTGAE(robot.clamp.joint), dtype=int)
    return found


def _rows_of_nodes(robots: Sequence[TendonActuation]) -> list[RobotNodes]:
    """Of every robot, the numbers of its nodes and of those with holes, among the nodes of all robots."""
    found, first = [], 0
    for robot in robots:
        every = first + np.arange(len(robot.nodes))
        found.append(RobotNodes(every, every[robot.model.cable_nodes]))
        first += len(every)
    return found


def _nothing_but_robots(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> bool:
    """Whether no other object has coordinates, and the beams have the stiffness of the robots' meshes."""
    data = mbs.systemData
    own = {i for robot in robots for i in robot.connectors.object_numbers}
    if any(len(data.GetObjectLTGODE2(i)) for i in range(data.NumberOfObjects()) if i not in own):
        return False
    for robot in robots:
        for beam, expected in zip(robot.connectors.beams, robot.mesh.stiffness, strict=True):
            present = mbs.GetObjectParameter(beam, "sectionData").stiffnessMatrix
            if not np.array_equal(present, np.diag(expected)):
                return False
    return True


def _turns(load: dict[str, Any]) -> bool:
    """Whether a load of Exudyn changes with the configuration of the node it acts on."""
    return load["loadType"] != "MassProportional" and not (
        load["loadType"] == "ForceVector" and not load["bodyFixed"]
    )
