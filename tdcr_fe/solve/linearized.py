"""A scene with robots linearised about its present state: `TDCREigenvalues`, and `TDCRLinearized` with its inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import exudyn as exu
import numpy as np
from scipy.linalg import eig

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.native.scene_forces import Holes
from tdcr_fe.elements.section_forces import DIFFERENCE
from tdcr_fe.model.schema import Keys, Quantity, check_arguments, check_instance
from tdcr_fe.scene.builder import check_system
from tdcr_fe.solve.equations.kernel import StaticKernel

_MODES = Keys({"numberOfEigenvalues": Annotated[int, Quantity(ge=1)]})


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a scene.

    Attributes
    ----------
    frequencies : ndarray, shape (k,)
        Ascending [Hz]; zero for a mode that does not swing, because it is unstable or moves freely.
    growth : ndarray, shape (k,)
        Rate at which the mode grows by itself [1/s]: positive where the state is unstable.
    shapes : ndarray, shape (n, k)
        By column, change of all ODE2 coordinates of the scene, the largest 1.
    """

    frequencies: Array
    growth: Array
    shapes: Array

    def show(self, mbs: exu.MainSystem, number: int, amplitude: float) -> None:
        """Put a scene into its present state plus a mode, to draw it; `hide` takes the mode away again.

        Parameters
        ----------
        mbs
            The scene, in the state of which these are the modes.
        number
            Number of the mode, from 0.
        amplitude
            Amplitude of the coordinate that moves most [m], or [1] for an Euler parameter.
        """
        data = mbs.systemData
        data.SetODE2Coordinates(np.array(data.GetODE2Coordinates()) + amplitude * self.shapes[:, number])

    def hide(self, mbs: exu.MainSystem, number: int, amplitude: float) -> None:
        """Take a mode away again; arguments as in `show`."""
        self.show(mbs, number, -amplitude)


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``M x'' + D x' + K x = B u``, ``y = C x``: small motions about a state of a scene.

    Attributes
    ----------
    mass, damping, stiffness : ndarray, shape (n, n)
    inputs : ndarray, shape (n, m)
        ``B``: by the change of every input, tension [N] or displacement [m] as the tendon is driven.
    input_names : tuple of str
        ``robot.tendon`` of every input.
    by_displacement : ndarray of bool, shape (m,)
        Which inputs are displacements.
    outputs : ndarray, shape (p, n)
        ``C``: change of every component of the sensors.
    basis : ndarray, shape (coordinates, n)
        Change of all ODE2 coordinates of the scene: what joints permit, ``basis @ x``.
    """

    mass: Array
    damping: Array
    stiffness: Array
    inputs: Array
    input_names: tuple[str, ...]
    by_displacement: Flags
    outputs: Array
    basis: Array

    def state_space(self) -> tuple[Array, Array, Array]:
        """``A``, ``B`` and ``C`` of first order, ``z' = A z + B u`` with ``z = (x, x')``."""
        n = len(self.mass)
        below = np.linalg.solve(self.mass, np.hstack((-self.stiffness, -self.damping, self.inputs)))
        a = np.vstack((np.eye(n, 2 * n, n), below[:, : 2 * n]))
        b = np.vstack((np.zeros_like(self.inputs), below[:, 2 * n :]))
        return a, b, np.hstack((self.outputs, np.zeros_like(self.outputs)))

    def static_gain(self) -> Array:
        """Change of the outputs at rest with the inputs, ``C K^-1 B``, shape (p, m)."""
        return np.asarray(self.outputs @ np.linalg.solve(self.stiffness, self.inputs))


def TDCREigenvalues(mbs: exu.MainSystem, *, holes: Holes = "stuck", numberOfEigenvalues: int = 10) -> Modes:
    """Eigenfrequencies and modes of small undamped vibrations about the present state of a scene.

    The state must be at rest, as `SolveTDCR` leaves it. Mass and stiffness are those of
    ``mbs.ComputeLinearizedSystem``, projected on what joints permit; the stiffness includes that of the tendons, and
    what is left out there: that of loads that turn, of the forces of joints, which hold a pendulum, and of triangles.
    ``mbs.ComputeLinearizedSystem`` and ``mbs.ComputeODE2Eigenvalues`` themselves take the initial configuration, with
    stuck holes.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot.
    holes
        "stuck": no hole slips beyond its presliding, as in vibrations that are small enough. "sliding": every hole
        slides on, as on top of a motion that goes on.
    numberOfEigenvalues
        Number of modes, the lowest ones.

    Returns
    -------
    Modes

    Raises
    ------
    ValueError
        The system is not assembled or has no robot, or an argument is another.
    """
    check_arguments("TDCREigenvalues", _MODES, locals())
    mass, stiffness, _, basis = _matrices(mbs, _checked_hooks("TDCREigenvalues", mbs, holes), holes)
    squared, vectors = eig(stiffness, mass)
    moving = np.isfinite(squared)
    squared, vectors = squared[moving], vectors[:, moving]
    rates = 1j * np.sqrt(squared.astype(complex))
    order = np.argsort(np.abs(squared))[:numberOfEigenvalues]
    shapes = basis @ np.real(vectors[:, order])
    frequencies, growth = np.abs(rates.imag[order]) / (2.0 * np.pi), np.abs(rates.real[order])
    return Modes(frequencies, growth, shapes / np.abs(shapes).max(axis=0))


def TDCRLinearized(
    mbs: exu.MainSystem, *, holes: Holes = "sliding", sensors: Sequence[Any] = ()
) -> LinearSystem:
    """Linearise a scene about its present state at rest, with the tendons of all robots as inputs.

    Mass, damping and stiffness are those of ``mbs.ComputeLinearizedSystem`` on the coordinates that joints permit; the
    stiffness includes that of the tendons, of loads that turn and of the forces of joints.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot, in a state as `SolveTDCR` leaves it.
    holes
        As in `TDCREigenvalues`: "sliding" on top of a motion that goes on, as under a controller, whose inputs move
        the tendons at once; "stuck" for motions so small that no hole slips beyond its presliding.
    sensors
        Numbers of the sensors that are the outputs, as of ``arm.sensors["tip_position"]``; their values follow from
        coordinates.

    Returns
    -------
    LinearSystem

    Raises
    ------
    ValueError
        The system is not assembled or has no robot, or an argument is another.
    """
    hint = "a list of numbers of sensors, such as [arm.sensors['tip_position']]"
    check_instance("TDCRLinearized", "sensors", sensors, (list, tuple), hint)
    hooks = _checked_hooks("TDCRLinearized", mbs, holes)
    mass, stiffness, damping, basis = _matrices(mbs, hooks, holes)
    columns, names = [], []
    for robot in hooks.robots:
        forces = np.zeros((len(basis), robot.law.shape[0]))
        forces[robot.coordinates.reshape(-1)] = robot.forces_by_inputs(holes == "stuck")
        columns.append(forces)
        names += [mbs.GetNode(node)["name"].removesuffix(".history") for node in robot.history_nodes.nodes]
    inputs = basis.T @ np.hstack(columns)
    driven = np.concatenate([robot.drives.winds for robot in hooks.robots])
    outputs = _outputs(mbs, sensors, basis)
    return LinearSystem(mass, damping, stiffness, inputs, tuple(names), driven, outputs, basis)


def _checked_hooks(function: str, mbs: exu.MainSystem, holes: Holes) -> SceneHooks:
    """Hooks of an assembled system with a robot; anything else is refused in the name of a function."""
    check_system(function, mbs)
    if holes not in ("stuck", "sliding"):
        raise ValueError(f"{function}: holes = {holes!r}; must be 'stuck' or 'sliding'")
    hooks = SceneHooks.of(mbs)
    if not hooks.robots:
        raise ValueError("no robot in this system; add one with CreateTDCR")
    if not mbs.systemIsConsistent:
        raise ValueError("the system is not assembled; call mbs.Assemble()")
    hooks.refuse_motors(function)
    return hooks


def _matrices(mbs: exu.MainSystem, hooks: SceneHooks, holes: Holes) -> tuple[Array, Array, Array, Array]:
    """Mass, stiffness and damping on the coordinates that joints permit, and what these change, see `LinearSystem`.

    Exudyn linearises about the initial configuration, so the present state is made the initial one meanwhile.
    """
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    present, before = data.GetSystemState(), data.GetSystemState(initial)
    data.SetSystemState(present, initial)
    for robot in hooks.robots:
        robot.holes = holes
    try:
        with hooks.without_post_step():
            mass, stiffness, damping, _, free = mbs.ComputeLinearizedSystem(
                projectIntoConstraintNullspace=True, returnConstraintNullspace=True
            )
        # What was left out: turning loads, forces of joints, and contact with triangles.
        kernel, n2 = StaticKernel(mbs, hooks), data.ODE2Size()
        kernel.contact.follow()
        # Multipliers of the dynamic solver have the other sign; at rest the right one leaves nothing unbalanced.
        multipliers: Array = data.GetAECoordinates(exu.ConfigurationType.Current, copy=False)
        unbalanced = np.linalg.norm(kernel.residual()[:n2])
        multipliers *= -1.0
        if np.linalg.norm(kernel.residual()[:n2]) > unbalanced:
            multipliers *= -1.0
        left_out = (kernel.exudyns_jacobian() - kernel.jacobian(loads=True))[:n2, :n2]
        stiffness = stiffness + free @ left_out @ free.T
    finally:
        for robot in hooks.robots:
            robot.holes = "present"
        data.SetSystemState(before, initial)
        data.SetSystemState(present)
    return np.asarray(mass), np.asarray(stiffness), np.asarray(damping), np.asarray(free).T


def _outputs(mbs: exu.MainSystem, sensors: Sequence[Any], basis: Array) -> Array:
    """Change of the values of sensors with the coordinates, by differences, shape (p, n)."""
    data = mbs.systemData
    rest = np.array(data.GetODE2Coordinates())

    def values(coordinates: Array) -> Array:
        data.SetODE2Coordinates(coordinates)
        return np.concatenate([np.zeros(0), *(np.atleast_1d(mbs.GetSensorValues(s)) for s in sensors)])

    try:
        steps = DIFFERENCE * basis.T
        changes = [(values(rest + x) - values(rest - x)) / (2.0 * DIFFERENCE) for x in steps]
    finally:
        data.SetODE2Coordinates(rest)
    return np.array(changes).T
