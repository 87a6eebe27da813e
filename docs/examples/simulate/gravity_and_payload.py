r"""
Gravity and a payload
=====================

A horizontal robot sags under its own weight and under a mass at its tip. The closed form for small
deflections is in every textbook; here the deflection is large, and the elastica

.. math:: EI\, \theta'' = \bigl(w (L - s) + m g\bigr) \cos\theta , \qquad \theta(0) = 0 , \quad \theta'(L) = 0

is integrated by scipy.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.integrate import solve_bvp

import tdcr_fe as tdcr

LENGTH, PAYLOAD, G = 0.25, 3e-3, 9.81
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=6450.0)
robot = tdcr.Robot(backbone, tdcr.Disks.equally_spaced(10, LENGTH), tip_mass=PAYLOAD)
# The robot points along z; gravity along -x makes it a horizontal one.
model = tdcr.Model(gravity=(-G, 0.0, 0.0))
result = tdcr.simulate(robot, model, [tdcr.LoadStep("at rest")]).raise_if_failed()
sag = -result.tips[0, 0]

# %%
# The elastica: angle and its rate, and the position that follows from the angle.

weight = backbone.mass_per_length * G


def elastica(s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Derivatives of angle, curvature and height."""
    force = weight * (LENGTH - s) + PAYLOAD * G
    return np.vstack((y[1], force * np.cos(y[0]) / backbone.EI, np.sin(y[0])))


s = np.linspace(0.0, LENGTH, 50)
exact = solve_bvp(elastica, lambda a, b: np.array([a[0], a[2], b[1]]), s, np.zeros((3, 50)), tol=1e-8)
small = (weight * LENGTH**4 / 8.0 + PAYLOAD * G * LENGTH**3 / 3.0) / backbone.EI
print(
    f"sag {1e3 * sag:.3f} mm, elastica {-1e3 * exact.sol(LENGTH)[2]:.3f} mm, small deflections {1e3 * small:.3f} mm"
)
assert exact.success
assert abs(sag + exact.sol(LENGTH)[2]) < 1e-4 * LENGTH

figure, axes = plt.subplots(figsize=(6.0, 3.0), layout="constrained")
axes.plot(
    1e3 * result.steps[0].positions[:, 2],
    1e3 * result.steps[0].positions[:, 0],
    "o",
    markersize=3,
    label="finite elements",
)
along = np.linspace(0.0, LENGTH, 200)
angle = exact.sol(along)[0]
distance = np.concatenate(([0.0], np.cumsum(0.5 * (np.cos(angle[1:]) + np.cos(angle[:-1])) * np.diff(along))))
axes.plot(1e3 * distance, 1e3 * exact.sol(along)[2], label="elastica")
axes.set_xlabel("z [mm]")
axes.set_ylabel("height [mm]")
axes.set_aspect("equal")
axes.legend()
plt.show()
