"""A soft, tapered robot without disks hangs from its base and is pulled by two tendons inside its body."""

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
result = tdcr.simulate(robot, model, steps)
print(result)
assert result.converged
np.testing.assert_allclose(1e3 * result.tips[0], [0.0, 0.0, 300.734], atol=0.01)
np.testing.assert_allclose(1e3 * result.tips[2], [0.0, 146.34, 190.78], atol=0.05)
