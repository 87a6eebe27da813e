r"""
Displacements, and a slack tendon
=================================

Motors often prescribe how far a tendon is pulled in, not its tension. Two tendons on opposite sides: one is
pulled in by 3 mm, the other let out by more and more. Without friction and along the backbone the closed form
is an arc of angle :math:`\varphi`. With the compression :math:`\varepsilon` of the backbone the tendons are
pulled in by

.. math:: u_{1,2} = \pm r \varphi + \varepsilon L , \qquad \varphi = \frac{(T_1 - T_2)\, r L}{EI} , \qquad
          \varepsilon = \frac{T_1 + T_2}{EA} .

When the second one is let out farther than that, it is slack: its tension is zero, and letting it out more
changes nothing.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

LENGTH, OFFSET, PULLED = 0.25, 4.5e-3, 3e-3
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)
robot = tdcr.Robot(
    backbone=backbone,
    disks=tdcr.Disks.equally_spaced(10, LENGTH),
    tendons=(
        tdcr.Tendon("right", tdcr.ParallelRouting(OFFSET)),
        tdcr.Tendon("left", tdcr.ParallelRouting(OFFSET, 180.0)),
    ),
)
let_out = np.linspace(2.98e-3, 3.0e-3, 21)
steps = [tdcr.LoadStep(displacements={"right": PULLED, "left": -float(u)}) for u in let_out]
model = tdcr.Model(tendon_path="continuous", friction="none", elements_per_bay=1)
result = tdcr.simulate(robot, model, steps).raise_if_failed()
tensions = np.array([step.base_tensions for step in result.steps])

# %%
# The closed form: with the left tendon slack, :math:`T_1 = u_1 / (r^2 L / EI + L / EA)`; otherwise two equations
# for two tensions.

by_bending, by_compression = OFFSET**2 * LENGTH / backbone.EI, LENGTH / backbone.EA
flexibility = np.array(
    [
        [by_bending + by_compression, by_compression - by_bending],
        [by_compression - by_bending, by_bending + by_compression],
    ]
)
expected = np.array([np.linalg.solve(flexibility, [PULLED, -u]) for u in let_out])
slack = expected[:, 1] < 0.0
expected[slack] = [PULLED / flexibility[0, 0], 0.0]
print(
    f"slack from {1e3 * let_out[slack][0]:.3f} mm on; largest difference {np.abs(tensions - expected).max():.1e} N"
)
assert 0 < slack.sum() < len(slack)
assert np.all(tensions[slack, 1] == 0.0)
assert np.abs(tensions - expected).max() < 1e-4 * expected.max()

figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
for k, name in enumerate(robot.tendon_names):
    axes.plot(1e3 * let_out, tensions[:, k], "o", color=f"C{k}", markersize=4, label=name)
    axes.plot(1e3 * let_out, expected[:, k], color=f"C{k}", linewidth=1.0, label=f"{name}, closed form")
axes.set_xlabel("left tendon let out [mm]")
axes.set_ylabel("tension [N]")
axes.legend()
plt.show()
