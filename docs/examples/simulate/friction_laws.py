r"""
Friction laws
=============

The coefficient of friction at a hole is constant, falls with the rate of slip (Stribeck), or changes with the
normal force. Whatever the law, the tension falls by the Capstan factor :math:`e^{-\mu_k \theta_k}` at a hole
through which the tendon is pulled. The turning angle :math:`\theta_k` is that between the two straight
segments, so the coefficient can be computed back from shape and tensions.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

LENGTH, OFFSET = 0.25, 4.5e-3
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)
disks = tdcr.Disks.equally_spaced(13, LENGTH)


def pull(law: object, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficient [1] and normal force [N] at the twelve holes when the tendon is pulled to 2 N within a time [s]."""
    tendon = tdcr.Tendon("t", tdcr.ParallelRouting(OFFSET), friction=law)
    robot = tdcr.Robot(backbone, disks, (tendon,))
    steps = [tdcr.LoadStep(tensions={"t": 2.0 * k / 8}, time=duration * k / 8) for k in range(9)]
    step = tdcr.simulate(robot, tdcr.Model(elements_per_bay=1), steps).raise_if_failed().steps[-1]
    nodes = np.searchsorted(step.s, robot.hole_arc_lengths(tendon) - 1e-9)
    holes = step.positions[nodes] + OFFSET * step.rotations[nodes][:, :, 0]
    directions = np.diff(holes, axis=0) / np.linalg.norm(np.diff(holes, axis=0), axis=1)[:, None]
    angle = np.arccos(np.einsum("ij,ij->i", directions[1:], directions[:-1]))
    before, behind = step.tensions[0][:-1], step.tensions[0][1:]
    return np.log(before / behind) / angle, (before + behind) * np.sin(angle / 2.0)


# %%
# A constant coefficient is the same at every hole.

constant, _ = pull(tdcr.ConstantFriction(0.3), 1.0)
print(f"constant: {constant.min():.6f} to {constant.max():.6f}")
assert np.allclose(constant, 0.3, rtol=1e-5)

# %%
# Stribeck: pulled slowly the coefficient is the static one, pulled fast the kinetic one.

stribeck = tdcr.StribeckFriction(static=0.3, kinetic=0.15, stribeck_rate=5e-3)
slow, fast = pull(stribeck, 1000.0)[0], pull(stribeck, 0.01)[0]
print(f"Stribeck: {slow.mean():.4f} slow, {fast.mean():.4f} fast")
assert np.allclose(slow, 0.3, rtol=1e-3)
assert np.allclose(fast[:6], 0.15, rtol=1e-3)

# %%
# Dependent on the normal force: a power law, here with the exponent -1/3 of an elastic contact.

hertz = tdcr.ForceDependentFriction(mu=0.3, reference_force=0.2, exponent=-1.0 / 3.0)
coefficient, force = pull(hertz, 1.0)
expected = 0.3 * (force / 0.2) ** (-1.0 / 3.0)
print(f"force-dependent: {coefficient.min():.4f} to {coefficient.max():.4f}")
assert np.allclose(coefficient, expected, rtol=1e-4)

figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
number = np.arange(1, 13)
for values, label in (
    (constant, "constant"),
    (slow, "Stribeck, slow"),
    (fast, "Stribeck, fast"),
    (coefficient, "by normal force"),
):
    wide = 5.0 if label == "constant" else 1.5
    axes.plot(number, values, "o-", linewidth=wide, markersize=wide + 2.5, label=label)
axes.set_xlabel("hole, from the base")
axes.set_ylabel("coefficient of friction")
axes.set_ylim(0.0, 0.4)
axes.legend()
plt.show()
