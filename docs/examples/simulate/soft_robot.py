r"""
Soft, tapered arm
=================

A soft robot without disks hangs from its base and is pulled by two tendons inside its body. Hanging, it
stretches by its own weight: at every section the force is the weight below it,

.. math:: \Delta L = \int_0^L \frac{\rho g \int_s^L A}{E\, A(s)}\, \mathrm{d}s .
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

body = tdcr.Backbone(
    length=0.3,
    radius=12e-3,
    taper=((0.0, 12e-3), (0.25, 6e-3), (0.3, 5e-3)),
    youngs_modulus=0.4e6,
    poisson_ratio=0.45,
    density=1100.0,
)
robot = tdcr.Robot(
    body,
    tendons=(
        tdcr.Tendon("left", tdcr.ConvergingRouting(offset=9e-3, end_offset=3e-3, angle_deg=120.0), end=0.25),
        tdcr.Tendon("right", tdcr.ConvergingRouting(offset=9e-3, end_offset=3e-3, angle_deg=60.0), end=0.25),
    ),
)

# The robot points along +z, so that it hangs where gravity does so, too.
model = tdcr.Model(tendon_path="continuous", friction="none", gravity=(0.0, 0.0, 9.81))
steps = [
    tdcr.LoadStep("hang"),
    tdcr.LoadStep("pull left", tensions={"left": 2.0}),
    tdcr.LoadStep("pull both", tensions={"right": 2.0}),
]
result = tdcr.simulate(robot, model, steps).raise_if_failed()
print(result)

# %%
# The closed form, by the trapezoidal rule on a fine grid.

s = np.linspace(0.0, body.length, 2001)
area = np.pi * body.radius_at(s) ** 2
below = np.concatenate((np.cumsum((0.5 * (area[1:] + area[:-1]) * np.diff(s))[::-1])[::-1], [0.0]))
stretch = np.trapezoid(body.density * 9.81 * below / (body.youngs_modulus * area), s)
print(f"stretch {1e3 * (result.tips[0, 2] - body.length):.4f} mm, closed form {1e3 * stretch:.4f} mm")
assert abs(result.tips[0, 2] - body.length - stretch) < 0.002 * stretch

# %%
# Both tendons with the same tension bend the arm in the plane of symmetry.

assert abs(result.tips[2, 0]) < 1e-6 * body.length

axes = plt.figure(figsize=(6.0, 4.5), layout="constrained").add_subplot(projection="3d")
for step in result.steps:
    axes.plot(*(1e3 * step.positions.T), label=step.label, linewidth=3.0)
axes.set_xlabel("x [mm]")
axes.set_ylabel("y [mm]")
axes.set_zlabel("z [mm], downwards")
axes.invert_zaxis()
axes.legend(loc="upper left")
plt.show()
