"""How a tendon is driven at its base: what is prescribed there, what is unknown, and the equation that closes it.

Every drive prescribes one of two quantities, in a unit of its own:

- the tension ``T`` at the base. Nothing is unknown;
- the length ``d = r x`` that it winds, a multiple of its input ``x``. The tension is unknown. With the material ``u``
  that the tendon gives off, a spring of compliance ``c`` between drive and tendon, and the tension ``T0`` in the
  unloaded robot where ``d`` is zero,

      u + c (T - T0) = d   with   T >= 0 ,   or   T = 0   and   u - c T0 >= d ,

  so that ``T = T0 + k (r x - u)``, never negative, with a spring of stiffness ``k``. Tendons count what the spring
  gives as their own (`tdcr_fe.elements.friction.TendonParameters.spring`), with its derivative ``c`` by the tension.

Adding a drive takes an entry of `DRIVES`, and a field of `tdcr_fe.model.loading.LoadStep` of the name ``inputs``; where
its scale follows from a number of its own, that as a field of `tdcr_fe.model.robot.Tendon`; and for scenes a setter in
`tdcr_fe.scene.assembled_robot`, such as ``set_motor_angles``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tdcr_fe.elements import Array, Flags


@dataclass(frozen=True)
class Drive:
    """One kind of drive."""

    name: str  # Before the tendon's name in columns of ``loading.csv``
    inputs: str  # Key of a load step
    unit: str
    winds: bool  # Whether it prescribes the length that it winds; else the tension
    # Length [m] or tension [N] by the unit of the input, of a tendon
    scale: Callable[[Any], float] = lambda tendon: 1.0
    # Why a tendon cannot be driven so; empty where it can
    obstacle: Callable[[Any], str] = lambda tendon: ""

    def __reduce__(self) -> str:
        return self.name.upper()  # the constant of this module

    @property
    def label(self) -> str:
        """Its name in words."""
        return self.name.replace("_", " ")


def _no_spool(tendon: Any) -> str:
    text = f"tendon {tendon.name} has no spool for a motor; give it one, such as spool = {{ radius = 8e-3 }}"
    return text if tendon.spool is None else ""


TENSION = Drive("tension", "tensions", "N", winds=False)
DISPLACEMENT = Drive("displacement", "displacements", "m", winds=True)
MOTOR_ANGLE = Drive(
    "motor_angle",
    "motor_angles",
    "rad",
    winds=True,
    scale=lambda tendon: tendon.spool.radius,
    obstacle=_no_spool,
)

#: All drives.
DRIVES = (TENSION, DISPLACEMENT, MOTOR_ANGLE)


@dataclass(frozen=True, eq=False)
class TendonDrives:
    """How all tendons of a robot are driven."""

    kinds: tuple[Drive, ...]  # By tendon
    scale: Array  # (m,): Tension [N] or length wound [m] by the unit of the input

    @classmethod
    def of(cls, kinds: Iterable[Drive], tendons: Sequence[Any]) -> TendonDrives:
        """One kind for each tendon."""
        kinds = tuple(kinds)
        scale = [kind.scale(tendon) for kind, tendon in zip(kinds, tendons, strict=True)]
        return cls(kinds, np.array(scale, dtype=float))

    def replaced(self, index: int, kind: Drive, scale: float) -> TendonDrives:
        """The same with another drive of one tendon, of a scale of its own."""
        scales = self.scale.copy()
        scales[index] = scale
        return TendonDrives((*self.kinds[:index], kind, *self.kinds[index + 1 :]), scales)

    @cached_property
    def winds(self) -> Flags:
        """Which tendons have the length prescribed that is wound, their tensions being unknown; shape (m,)."""
        return np.array([kind.winds for kind in self.kinds], dtype=bool)

    @cached_property
    def least(self) -> Array:
        """Smallest inputs: zero for tensions, any finite number for what is wound; shape (m,)."""
        return np.where(self.winds, np.finfo(float).min, 0.0)
