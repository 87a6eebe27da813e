r"""
Vibration
=========

A rod without disks is bent by a force at its tip and let go. It swings with its first natural frequency; for
small motions that of the cantilever of Euler and Bernoulli is

.. math:: f_1 = \frac{1.8751^2}{2\pi} \sqrt{\frac{EI}{\rho A L^4}} .
"""

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np

import tdcr_fe as tdcr

tdcr.register()

LENGTH = 0.25
backbone = tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3, density=6450.0)
SC = exu.SystemContainer()
mbs = SC.AddSystem()
arm = mbs.CreateTDCR(
    tdcr.Robot(backbone), tdcr.Model(tendon_path="continuous", friction="none", elements_per_bay=1)
)
tip = arm.add_load("tip", at=LENGTH)
mbs.Assemble()

# %%
# At rest first: ``mbs.SolveTDCR``. Its natural frequencies follow from the linearised scene.

closed_form = 1.87510407**2 / (2.0 * np.pi) * np.sqrt(backbone.EI / (backbone.mass_per_length * LENGTH**4))
tip.set([1e-3, 0.0, 0.0])
mbs.SolveTDCR()
bent = arm.tip_position[0]
frequency = tdcr.TDCREigenvalues(mbs, numberOfEigenvalues=2).frequencies[0]
print(f"bent by {1e3 * bent:.3f} mm; first frequency {frequency:.4f} Hz, closed form {closed_form:.4f} Hz")
assert abs(frequency / closed_form - 1.0) < 5e-3

# %%
# Released, and followed in time for three periods. The time of zero crossings gives the period.

tip.set([0.0, 0.0, 0.0])
period = 1.0 / closed_form
settings = arm.recommended_settings(3.0 * period, period / 200.0)
settings.timeIntegration.verboseMode = 0
settings.solution.file.write = False
tip_x: list[float] = []
time: list[float] = []


def record(mbs: exu.MainSystem, t: float) -> bool:
    """Note the tip after every step."""
    time.append(t)
    tip_x.append(arm.tip_position[0])
    return True


mbs.SetPostStepUserFunction(record)
mbs.SolveDynamic(settings)
t, x = np.array(time), np.array(tip_x)
falls = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
crossing = t[falls] + (t[falls + 1] - t[falls]) * x[falls] / (x[falls] - x[falls + 1])
measured = 1.0 / np.diff(crossing).mean()
print(f"frequency of the motion {measured:.4f} Hz")
assert abs(measured / closed_form - 1.0) < 5e-3

figure, axes = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
axes.plot(1e3 * t, 1e3 * x)
axes.set_xlabel("time [ms]")
axes.set_ylabel("tip [mm]")
plt.show()
