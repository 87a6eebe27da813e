r"""
Tendon Jacobian
===============

How the tip moves when a tendon is pulled a little more: the Jacobian that kinematic controllers of continuum
robots use, here of the whole mechanical model. For tendons along the backbone and without friction the
backbone is an arc of angle :math:`\varphi = T r L / EI`, so

.. math:: x = \frac{L}{\varphi} (1 - \cos\varphi) , \qquad z = \frac{L}{\varphi} \sin\varphi ,

with the length :math:`L (1 - T / EA)`, and the derivative by the tension follows by hand.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

LENGTH, OFFSET = 0.25, 4.5e-3
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)


def arm(friction: float) -> tdcr.Robot:
    """Three tendons around the backbone."""
    tendons = tuple(
        tdcr.Tendon(
            f"t{k + 1}", tdcr.ParallelRouting(OFFSET, angle_deg=120.0 * k), friction_coefficient=friction
        )
        for k in range(3)
    )
    return tdcr.Robot(backbone, tdcr.Disks.equally_spaced(10, LENGTH), tendons)


tension = np.linspace(0.25, 2.5, 10)
steps = [tdcr.LoadStep(tensions={"t1": float(t)}) for t in tension]
classical = tdcr.Model(tendon_path="continuous", friction="none", elements_per_bay=1)
found = tdcr.simulate(arm(0.0), classical, steps, responses=True).raise_if_failed()
jacobian = np.array([step.responses[0].by_tension[:3, 0] for step in found.steps])

# %%
# The closed form, with :math:`\mathrm{d}\varphi / \mathrm{d}T = r L / EI` and the compression.

turn = tension * OFFSET * LENGTH / backbone.EI
rate = OFFSET * LENGTH / backbone.EI
length, shorter = LENGTH * (1.0 - tension / backbone.EA), -LENGTH / backbone.EA
x = (
    length * rate * (np.sin(turn) / turn - (1.0 - np.cos(turn)) / turn**2)
    + shorter * (1.0 - np.cos(turn)) / turn
)
z = length * rate * (np.cos(turn) / turn - np.sin(turn) / turn**2) + shorter * np.sin(turn) / turn
print(
    f"at 2.5 N: {1e3 * jacobian[-1, 0]:.4f} and {1e3 * jacobian[-1, 2]:.4f} mm/N, "
    f"closed form {1e3 * x[-1]:.4f} and {1e3 * z[-1]:.4f}"
)
assert np.allclose(jacobian[:, 0], x, atol=1e-4 * np.abs(x).max())
assert np.allclose(jacobian[:, 2], z, atol=1e-4 * np.abs(z).max())

# %%
# With friction there are two Jacobians in one state: one for continuing, one for the first motion after a
# reversal, when all holes stick. A controller that uses one matrix for both is wrong by their difference.

rough = tdcr.simulate(arm(0.3), tdcr.Model(elements_per_bay=1), steps, responses=True).raise_if_failed()
onwards, back = (np.array([step.responses[k].by_tension[0, 0] for step in rough.steps]) for k in range(2))
assert np.all(onwards[1:] > 2.0 * back[1:])

figure, axes = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
axes.plot(tension, 1e3 * jacobian[:, 0], "o", color="C0", label="no friction")
axes.plot(tension, 1e3 * x, color="C0", label="closed form")
axes.plot(tension, 1e3 * onwards, "C1s-", markersize=4, label="friction 0.3, going on")
axes.plot(tension, 1e3 * back, "C3s-", markersize=4, label="friction 0.3, first motion back")
axes.set_xlabel("tension of t1 [N]")
axes.set_ylabel("tip x by tension [mm/N]")
axes.legend()
plt.show()
