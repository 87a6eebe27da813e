"""
Thick disks and wide holes
==========================

A disk with a thickness is a rigid insert of the backbone. A hole that is wider than the tendon lets it move
sideways by the clearance. Both have a counterpart without: a shorter elastic length, and another offset.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

LENGTH, OFFSET, TENSION = 0.25, 4.5e-3, 2.0
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3)


def bend(model: tdcr.Model, tendon: tdcr.Tendon, thickness: float = 0.0) -> float:
    """Bending angle of the robot under tension [rad]."""
    robot = tdcr.Robot(backbone, tdcr.Disks.equally_spaced(10, LENGTH, thickness=thickness), (tendon,))
    steps = [tdcr.LoadStep(tensions={tendon.name: TENSION})]
    return float(tdcr.simulate(robot, model, steps).raise_if_failed().bending_angles[-1])


# %%
# Where tendons follow the backbone the moment is constant, and the bending angle is that of the elastic
# length alone. Of the disk at the tip half its thickness lies on the backbone.

classical = tdcr.Model(tendon_path="continuous", friction="none")
thickness = np.linspace(0.0, 8e-3, 5)
angles = np.array([bend(classical, tdcr.Tendon("t", tdcr.ParallelRouting(OFFSET)), t) for t in thickness])
closed_form = TENSION * OFFSET * (LENGTH - 9.5 * thickness) / backbone.EI
print(f"8 mm thick: {np.degrees(angles[-1]):.3f} degrees, closed form {np.degrees(closed_form[-1]):.3f}")
assert np.allclose(angles, closed_form, rtol=1e-4)

# %%
# A tendon under tension moves to the inner side of the bend, away from the backbone, since there it is
# shortest. It cannot move at its anchor. So the robot bends like one whose other holes are farther out by the
# clearance.

CLEARANCE = 0.3e-3
straight = tdcr.Model(friction="none")
tight = bend(straight, tdcr.Tendon("t", tdcr.ParallelRouting(OFFSET)))
wide = bend(straight, tdcr.Tendon("t", tdcr.ParallelRouting(OFFSET), clearance=CLEARANCE))
edges = (0.0, *tdcr.Disks.equally_spaced(10, LENGTH).positions)
farther = (*[(OFFSET + CLEARANCE, 0.0)] * 10, (OFFSET, 0.0))
shifted = bend(straight, tdcr.Tendon("t", tdcr.PointsRouting(edges, farther)))
print(
    f"{np.degrees(tight):.3f} degrees, with clearance {np.degrees(wide):.3f}, "
    f"with shifted holes {np.degrees(shifted):.3f}"
)
assert wide - tight > np.radians(4.0)
assert abs(wide - shifted) < np.radians(0.05)

figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
axes.plot(1e3 * thickness, np.degrees(angles), "o", label="finite elements")
axes.plot(1e3 * thickness, np.degrees(closed_form), label="closed form")
axes.set_xlabel("thickness of the disks [mm]")
axes.set_ylabel("bending angle [deg]")
axes.legend()
plt.show()
