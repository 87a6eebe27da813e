"""
Design by exact derivatives
===========================

Where should the disks sit, how far out should the tendon run, and how thick should the backbone be, for the
largest reach at 2 N, if pulled and released it may differ by at most 3 mm at 1 N? A run gives reach,
hysteresis and their derivatives by all parameters, and scipy does the rest.
"""

from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint, minimize

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, LoadStep, Model, ParallelRouting, Robot, Tendon

LENGTH, HYSTERESIS, SHORTEST, LONGEST = 0.25, 3e-3, 0.015, 0.06  # of the backbone; allowed; of a bay [m]
STEPS = [LoadStep(tensions={"t1": t}) for t in (1.0, 2.0, 1.0)]
BAYS = 6
NAMES = ["tendons.offset", "backbone.radius", *(f"disks.positions[{k}]" for k in range(BAYS - 1))]
# From the unknowns to the parameters of the robot [m]: lengths of all bays but the last add up to positions of disks.
PARAMETERS = np.zeros((BAYS + 1, BAYS + 1))
PARAMETERS[0, 0], PARAMETERS[1, 1] = 1e-3, 1e-4
PARAMETERS[2:, 2:] = 1e-2 * np.tri(BAYS - 1)


def robot(x):
    offset, radius, *disks = PARAMETERS @ x
    tendon = Tendon("t1", ParallelRouting(offset), friction_coefficient=0.2)
    return Robot(
        Backbone(LENGTH, radius, 85e9, 0.3), Disks((*disks, LENGTH), radius=offset + 1e-3), (tendon,)
    )


@cache
def solved(x):
    """Of the tip in mm, x at 2 N and distance at 1 N between both ways, with their derivatives."""
    model = Model(elements_per_bay=4)
    run = tdcr.simulate(robot(np.array(x)), model, STEPS, sensitivities=NAMES).raise_if_failed()
    by = np.einsum("nki,nm->mki", [run.sensitivities[n].tips for n in NAMES], PARAMETERS)
    apart = run.tips[2] - run.tips[0]
    size = np.linalg.norm(apart)
    return 1e3 * run.tips[1, 0], 1e3 * size, 1e3 * by[:, 1, 0], 1e3 * (by[:, 2] - by[:, 0]) @ apart / size


start = np.array([4.5, 5.0, *[1e2 * LENGTH / BAYS] * (BAYS - 1)])
inner = np.array([0.0, 0.0, *[1.0] * (BAYS - 1)])
found = minimize(
    lambda x: -solved(tuple(x))[0],
    start,
    jac=lambda x: -solved(tuple(x))[2],
    bounds=Bounds([3.0, 4.0, *[1e2 * SHORTEST] * (BAYS - 1)], [8.0, 8.0, *[1e2 * LONGEST] * (BAYS - 1)]),
    constraints=[
        NonlinearConstraint(
            lambda x: solved(tuple(x))[1], 0.0, 1e3 * HYSTERESIS, jac=lambda x: solved(tuple(x))[3]
        ),
        LinearConstraint(inner, 1e2 * (LENGTH - LONGEST), 1e2 * (LENGTH - SHORTEST)),
    ],
    method="SLSQP",
    options={"ftol": 1e-5},
)
designs = {"start": start, "optimum": found.x}
figure, axes = plt.subplots(1, 2, figsize=(7.5, 4.0), sharey=True, layout="constrained")
for ax, (name, x) in zip(axes, designs.items(), strict=True):
    reach, hysteresis, *_ = solved(tuple(x))
    offset, radius, *_ = 1e3 * PARAMETERS @ x
    print(
        f"{name}: reach {reach:.1f} mm, hysteresis {hysteresis:.2f} mm, offset {offset:.2f} mm, radius {radius:.3f} mm"
    )
    run = tdcr.simulate(robot(x), Model(), STEPS)
    for step, style in zip(run.steps, ("C0-", "C1-", "C0--"), strict=True):
        ax.plot(1e3 * step.positions[:, 0], 1e3 * step.positions[:, 2], style)
    on_disks = [np.argmin(np.abs(run.steps[1].s - s)) for s in robot(x).disks.positions]
    ax.plot(*(1e3 * run.steps[1].positions[on_disks][:, [0, 2]].T), "C1o", markersize=4)
    ax.set_title(f"{name}: {reach:.0f} mm")
    ax.set_xlabel("x [mm]")
    ax.set_aspect("equal")
axes[0].set_ylabel("z [mm]")
assert solved(tuple(start))[0] < 70.0 < 130.0 < solved(tuple(found.x))[0]
assert solved(tuple(found.x))[1] < 1e3 * HYSTERESIS + 1e-3
plt.show()
