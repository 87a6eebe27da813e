"""Share Exudyn's solver hooks among several robots and the user's own functions.

A system has one hook of each kind. `SceneHooks` occupies them and calls any function that was set before. A function
that the user sets later is added to the chain, so that it does not disable the tendons.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation

#: Key of the hooks in ``mbs.variables``.
KEY = "tdcr_fe.hooks"

_KINDS = ("PreNewtonResidual", "SystemJacobian", "PostStep")


class PointLoadItem(Protocol):
    """A concentrated load that a solver ramps from its last applied value to the value set since."""

    #: Force [N] and moment [N m] in the last solved state, shape (6,).
    applied: NDArray[np.float64]

    @property
    def value(self) -> NDArray[np.float64]:
        """Force [N] and moment [N m] as set, shape (6,)."""
        ...

    def set(self, force: NDArray[np.float64], moment: NDArray[np.float64]) -> None:
        """Set force [N] and moment [N m], each of shape (3,)."""
        ...


class SceneHooks:
    """The hooks of one system.

    Attributes
    ----------
    actuations : list of TendonActuation
        The robots in the system.
    point_loads : list of PointLoadItem
        The concentrated loads on them.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self.mbs = mbs
        self.actuations: list[TendonActuation] = []
        self.point_loads: list[PointLoadItem] = []
        self._own: dict[str, Callable[..., Any]] = {
            "PreNewtonResidual": self._before_residual,
            "SystemJacobian": self._jacobian,
            "PostStep": self._after_step,
        }
        self._users: dict[str, Callable[..., Any] | None] = dict.fromkeys(_KINDS)
        self.adopt()

    @classmethod
    def of(cls, mbs: exu.MainSystem) -> SceneHooks:
        """The hooks of a system, created at the first call."""
        if KEY not in mbs.variables:
            mbs.variables[KEY] = cls(mbs)
        hooks = mbs.variables[KEY]
        assert isinstance(hooks, cls)
        if hooks.actuations and mbs.systemData.NumberOfNodes() == 0:
            # The system was reset, which leaves mbs.variables as they are.
            hooks.actuations.clear()
            hooks.point_loads.clear()
            hooks._users = dict.fromkeys(_KINDS)
            hooks.adopt()
        return hooks

    def adopt(self) -> None:
        """Reinstall every hook, keeping the user's functions as part of the chain."""
        for kind in _KINDS:
            present = _function(getattr(self.mbs, f"Get{kind}UserFunction")())
            if present == self._own[kind]:
                continue
            if present is not None:
                self._users[kind] = present
            getattr(self.mbs, f"Set{kind}UserFunction")(self._own[kind])

    def user_function(self, kind: str) -> Callable[..., Any] | None:
        """The user's own function of a kind ("PreNewtonResidual", "SystemJacobian", "PostStep"), or None."""
        return self._users[kind]

    @contextmanager
    def without_post_step(self) -> Iterator[None]:
        """Disable the post-step hook: Exudyn's solvers call it when they are initialised."""
        present = _function(self.mbs.GetPostStepUserFunction())
        self.mbs.SetPostStepUserFunction(0)
        try:
            yield
        finally:
            self.mbs.SetPostStepUserFunction(present or 0)
            self.adopt()

    def user_jacobian(self, t: float) -> np.ndarray | None:
        """The user's own part of the system Jacobian, dense, or None."""
        user = self._users["SystemJacobian"]
        return None if user is None else _dense(user(self.mbs, t, 1.0, 0.0, 1.0))

    def _before_residual(self, mbs: exu.MainSystem, t: float, newton: int, discontinuous: int) -> None:
        if newton == 0:
            self.adopt()
        user = self._users["PreNewtonResidual"]
        if user is not None:
            user(mbs, t, newton, discontinuous)
        for actuation in self.actuations:
            actuation.forces = actuation.scene_forces(t)
            actuation.apply(actuation.forces)

    def _jacobian(
        self, mbs: exu.MainSystem, t: float, by_ode2: float, by_ode2_t: float, by_ode1: float
    ) -> Any:
        data = mbs.systemData
        size = data.ODE2Size() + data.ODE1Size() + data.AEsize()
        total = np.zeros((size, size))
        for actuation in self.actuations:
            numbers, matrix = actuation.scene_tangent()
            total[np.ix_(numbers, numbers)] += by_ode2 * matrix
        user = self._users["SystemJacobian"]
        if user is not None:
            part = _dense(user(mbs, t, by_ode2, by_ode2_t, by_ode1))
            total[: part.shape[0], : part.shape[1]] += part
        container = exu.MatrixContainer()
        container.SetWithDenseMatrix(total, useDenseMatrix=False)
        return container

    def _after_step(self, mbs: exu.MainSystem, t: float) -> bool:
        for actuation in self.actuations:
            actuation.commit_scene(t)
        for load in self.point_loads:
            load.applied = load.value
        user = self._users["PostStep"]
        return True if user is None else bool(user(mbs, t))


def _function(present: Any) -> Callable[..., Any] | None:
    """The return value of one of Exudyn's getters, as a Python function or None."""
    if isinstance(present, dict):
        present = present.get("function")
    return present if callable(present) else None


def _dense(container: Any) -> np.ndarray:
    """A MatrixContainer as a dense matrix."""
    return np.asarray(container.Convert2DenseMatrix(), dtype=float)
