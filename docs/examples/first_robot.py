"""The paper's robot pulled to 2.5 N and released, in Python."""

from math import degrees

import tdcr_fe as tdcr

robot = tdcr.Robot(
    name="single-segment",
    backbone=tdcr.Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=tdcr.Disks.equally_spaced(13, 0.25),
    tendons=(tdcr.Tendon("t1", tdcr.ParallelRouting(offset=4.5e-3), friction_coefficient=0.3),),
)
pulled = [tdcr.LoadStep(f"pull {t} N", tensions={"t1": t}) for t in (0.5, 1.0, 1.5, 2.0, 2.5)]
released = [tdcr.LoadStep(f"release to {t} N", tensions={"t1": t}) for t in (2.0, 1.5, 1.0, 0.5, 0.0)]
model = tdcr.Model(friction="per-hole", elements_per_bay=1)
result = tdcr.simulate(robot, model, pulled + released).raise_if_failed()
for step in result.steps:
    print(f"{step.label:18} {degrees(step.bending_angle):7.3f} deg   {step.tensions[0][-1]:.4f} N at the tip")
print(result)
assert abs(degrees(result.steps[4].bending_angle) - 80.243) < 0.001
