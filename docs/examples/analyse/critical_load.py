r"""
Critical load
=============

A column that is clamped at its base and pressed at its tip buckles at Euler's load :math:`P = \pi^2 EI /
(2L)^2`. The stability measure of a solved state is 1 for the unloaded rod, falls with the load as :math:`1 -
P / P_\mathrm{cr}`, and is zero where the equilibrium becomes unstable.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr
from tdcr_fe.model.loading import resolve

LENGTH = 0.25
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)
robot = tdcr.Robot(backbone, tdcr.Disks.equally_spaced(10, LENGTH))
euler = np.pi**2 * backbone.EI / (2.0 * LENGTH) ** 2
print(f"Euler's load {euler:.6f} N")

# %%
# The column is pressed along its axis in steps, up to 20 % beyond that load. It stays straight, since nothing
# disturbs it; the sign of the measure says from where on this is no longer stable. ``Simulation`` is the
# solver behind ``simulate``, step by step.

fractions = np.linspace(0.1, 1.2, 12)
steps = [
    tdcr.LoadStep(f"{f:.1f} of Euler", loads={"tip": tdcr.Load(at=LENGTH, force=(0.0, 0.0, -f * euler))})
    for f in fractions
]
loading = resolve(robot, steps)
simulation = tdcr.Simulation(robot, tdcr.Model(friction="none", elements_per_bay=1), loading)
measures = []
for target in loading:
    simulation.advance(target)
    measures.append(tdcr.stability(simulation).smallest)
critical = euler * np.interp(0.0, measures[::-1], fractions[::-1])
print(f"critical load {critical:.6f} N, {critical / euler:.6f} of Euler's")
assert abs(critical / euler - 1.0) < 1e-4
assert measures[9] * measures[10] < 0.0 or abs(measures[9]) < 1e-4

# %%
# The mode in which it would buckle is a quarter of a cosine wave.

mode = tdcr.stability(simulation).mode
sideways = np.linalg.norm(mode[:, :2], axis=1)
s = np.linspace(0.0, LENGTH, len(sideways))
assert np.allclose(sideways, 1.0 - np.cos(0.5 * np.pi * s / LENGTH), atol=0.01)

figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.5), layout="constrained")
left.plot(fractions, measures, "o-", markersize=4)
left.axhline(0.0, color="0.6", linewidth=0.8)
left.set_xlabel("load over Euler's load")
left.set_ylabel("smallest eigenvalue")
right.plot(sideways, 1e3 * s, "o", markersize=4, label="mode")
right.plot(1.0 - np.cos(0.5 * np.pi * s / LENGTH), 1e3 * s, label="quarter of a cosine")
right.set_xlabel("deflection (largest is 1)")
right.set_ylabel("arc length [mm]")
right.legend()
plt.show()
