"""
Hysteresis loop
===============

Pulled and released, a tendon with friction bends the robot along two different paths. After a closed loop the
elastic energy is what it was, so the work of the motor is what friction dissipated in the holes. Both are
computed here from the results.
"""

import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

LENGTH, OFFSET, MU = 0.25, 4.5e-3, 0.3
tendon = tdcr.Tendon("t", tdcr.ParallelRouting(OFFSET), friction_coefficient=MU)
robot = tdcr.Robot(
    backbone=tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=tdcr.Disks.equally_spaced(13, LENGTH),
    tendons=(tendon,),
)
tension = np.concatenate((np.linspace(0.0, 2.0, 41), np.linspace(2.0, 0.0, 41)[1:]))
steps = [tdcr.LoadStep(tensions={"t": float(t)}) for t in tension]
result = tdcr.simulate(robot, tdcr.Model(elements_per_bay=1), steps).raise_if_failed()

# %%
# Work of the motor: base tension times displacement, around the loop.

pulled_in = np.array([step.displacements[0] for step in result.steps])
work = np.trapezoid(tension, pulled_in)

# %%
# Work of friction: at each hole the difference of the tensions on both sides, times the slip. The slip at a
# hole is the displacement at the base minus what the segments before the hole have given up.

tensions = np.array([step.tensions[0] for step in result.steps])
lengths = []
for step in result.steps:
    nodes = np.searchsorted(step.s, robot.hole_arc_lengths(tendon) - 1e-9)
    holes = step.positions[nodes] + OFFSET * step.rotations[nodes][:, :, 0]
    lengths.append(np.linalg.norm(np.diff(holes, axis=0), axis=1))
given_up = lengths[0] - np.array(lengths)
slip = np.cumsum(given_up[:, ::-1], axis=1)[:, ::-1][:, 1:]
difference = tensions[:, :-1] - tensions[:, 1:]
dissipated = np.trapezoid(difference, slip, axis=0)
print(f"work of the motor {1e6 * work:.2f} uJ, of friction {1e6 * dissipated.sum():.2f} uJ")
assert work > 0.0 and np.all(dissipated > 0.0)
assert abs(dissipated.sum() / work - 1.0) < 2e-3

# %%
# While the tendon is released, holes reverse one after another, from the base on. Where a hole has reversed,
# the Capstan factor is inverted.

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.5), layout="constrained")
left.plot(tension, np.degrees(result.bending_angles))
left.set_xlabel("base tension [N]")
left.set_ylabel("bending angle [deg]")
for k in (40, 46, 52, 60):
    right.plot(np.arange(1, 14), tensions[k], "o-", markersize=3, label=f"step {k + 1}")
right.set_xlabel("segment, from the base")
right.set_ylabel("tension [N]")
right.legend()
plt.show()
