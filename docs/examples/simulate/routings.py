r"""
Four routings
=============

A tendon is parallel to the backbone, winds around it, converges towards it, or goes through holes that are
listed. For tendons that follow the backbone without friction the equilibrium has a closed form: the rod
carries what the tendon does not. With the tendon's path :math:`r(s)` in the section, its unit tangent
:math:`t` and its tension :math:`T`,

.. math:: n = -T\,t , \qquad m = -T\, r \times t .
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.linalg import expm
from scipy.optimize import fsolve

import tdcr_fe as tdcr

LENGTH, OFFSET, TENSION, TURNS = 0.25, 4.5e-3, 2.0, 1.0
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)
disks = tdcr.Disks.equally_spaced(25, LENGTH)
turned = np.linspace(0.0, 2.0 * np.pi * TURNS, 26)
routings = {
    "parallel": tdcr.ParallelRouting(OFFSET),
    "helical": tdcr.HelicalRouting(OFFSET, turns=TURNS),
    "converging": tdcr.ConvergingRouting(OFFSET, end_offset=0.5e-3),
    "points": tdcr.PointsRouting(
        (0.0, *disks.positions), tuple((OFFSET * np.cos(a), OFFSET * np.sin(a)) for a in turned)
    ),
}


def bend(name: str, path: str) -> tdcr.StepResult:
    """The robot with one tendon under tension, without friction."""
    robot = tdcr.Robot(backbone, disks, (tdcr.Tendon("t", routings[name]),), name=name)
    model = tdcr.Model(tendon_path=path, friction="none")
    return tdcr.simulate(robot, model, [tdcr.LoadStep(tensions={"t": TENSION})]).raise_if_failed().steps[-1]


# %%
# **Parallel.** The moment is constant, :math:`\kappa = T r / EI`, and so the backbone is an arc.

angle = TENSION * OFFSET * LENGTH / backbone.EI
found = bend("parallel", "continuous").bending_angle
print(f"parallel: {np.degrees(found):.4f} degrees, closed form {np.degrees(angle):.4f}")
assert abs(found / angle - 1.0) < 1e-4

# %%
# **Converging.** The distance falls linearly, and so does the curvature. The tendon's slope against the
# backbone and the curvature itself change the moment by less than a thousandth; here the equation is solved
# at each section.


def curvature(s: float) -> float:
    """Curvature where the moment of the tendon about the section is that of the rod [1/m]."""
    slope = (0.5e-3 - OFFSET) / LENGTH
    r = OFFSET + slope * s

    def unbalanced(k: float) -> float:
        along = 1.0 - k * r
        return k - TENSION * r * along / np.hypot(along, slope) / backbone.EI

    return float(fsolve(unbalanced, TENSION * r / backbone.EI)[0])


sections, weights = np.polynomial.legendre.leggauss(12)
angle = (
    0.5
    * LENGTH
    * sum(w * curvature(0.5 * LENGTH * (1.0 + x)) for x, w in zip(sections, weights, strict=True))
)
found = bend("converging", "continuous").bending_angle
print(f"converging: {np.degrees(found):.4f} degrees, closed form {np.degrees(angle):.4f}")
assert abs(found / angle - 1.0) < 2e-4

# %%
# **Helical.** In a frame that turns with the tendon the strains are constant: six equations for six unknowns.
# The backbone is a helix, whose end is a matrix exponential.

pitch = 2.0 * np.pi * TURNS / LENGTH
stiffness = np.array([backbone.GA, backbone.GA, backbone.EA, backbone.EI, backbone.EI, backbone.GJ])
place = np.array([OFFSET, 0.0, 0.0])


def unbalanced(strain: np.ndarray) -> np.ndarray:
    """Wrench of the rod plus that of the tendon, in the turning frame."""
    stretch, turn = strain[:3], strain[3:] + np.array([0.0, 0.0, pitch])
    tangent = stretch + np.cross(turn, place)
    force = TENSION * tangent / np.linalg.norm(tangent)
    rod = stiffness * (strain - [0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    return rod + np.concatenate((force, np.cross(place, force)))


strain = fsolve(unbalanced, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], xtol=1e-13)
x, y, z = strain[3:] + np.array([0.0, 0.0, pitch])
twist = np.zeros((4, 4))
twist[:3, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
twist[:3, 3] = strain[:3]
tip = expm(LENGTH * twist)[:3, 3]
found = bend("helical", "continuous").tip
print(f"helical: tip at {np.round(1e3 * found, 3)} mm, closed form {np.round(1e3 * tip, 3)} mm")
assert np.linalg.norm(found - tip) < 2e-4 * LENGTH

# %%
# **Points.** Holes on the helix, given one by one, are the same robot where tendons run straight from hole to
# hole.

listed, helical = bend("points", "straight"), bend("helical", "straight")
assert np.linalg.norm(listed.tip - helical.tip) < 1e-9 * LENGTH

axes = plt.figure(figsize=(6.0, 4.5), layout="constrained").add_subplot(projection="3d")
for name in ("parallel", "converging", "helical"):
    axes.plot(*(1e3 * bend(name, "straight").positions.T), label=name)
axes.set_xlabel("x [mm]")
axes.set_ylabel("y [mm]")
axes.set_zlabel("z [mm]")
axes.set_box_aspect((1, 1, 1))
axes.legend(loc="upper left")
plt.show()
