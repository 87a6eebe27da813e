"""
A tendon is cut
===============

The robot swings back, and friction in the holes and the material of the backbone take its energy. The energy
sensor shows where it goes; elastic, kinetic and dissipated energy add up to what was stored.
"""

import exudyn as exu
import matplotlib.pyplot as plt

import tdcr_fe as tdcr
from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.scene.energy import ENERGY_COLUMNS

tdcr.register()

SC = exu.SystemContainer()
mbs = SC.AddSystem()
robot = Robot(
    name="arm",
    backbone=Backbone(0.25, 0.4e-3, 85e9, 0.3, density=5600.0, retardation_time=4e-3),
    disks=Disks.equally_spaced(13, 0.25, mass=0.17e-3),
    tendons=(
        Tendon("left", ParallelRouting(4.5e-3, angle_deg=180.0), friction_coefficient=0.2),
        Tendon("right", ParallelRouting(4.5e-3, angle_deg=0.0), friction_coefficient=0.2),
    ),
)
arm = mbs.CreateTDCR(robot, Model(friction="per-hole", elements_per_bay=1))
sensor = arm.add_energy_sensor()
mbs.Assemble()

arm.set_tensions({"left": 0.2, "right": 1.5})
mbs.SolveTDCR()
arm.set_tensions({"right": 0.0})

settings = arm.recommended_settings(0.2, 1e-3)
settings.timeIntegration.verboseMode = 0
# Little numerical damping, so that nearly all energy goes to friction and material.
settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
settings.solution.file.write = False
settings.solution.sensors.writePeriod = 1e-3
mbs.SolveDynamic(settings)

data = mbs.GetSensorStoredData(sensor)
first, last = (dict(zip(ENERGY_COLUMNS, row[1:], strict=True)) for row in (data[0], data[-1]))
for name, value in last.items():
    print(f"{name:22} {1e3 * first[name]:8.4f} {1e3 * value:8.4f} mJ")

stored = first["elastic"]
dissipated = last["friction_dissipation"] + last["material_dissipation"]
work = last["tendon_work"] - first["tendon_work"]
rest = stored + work - last["elastic"] - last["kinetic"] - dissipated
print(f"lost by the integration in time: {1e3 * rest:.4f} mJ")  # no other item takes energy

assert last["friction_dissipation"] > 0.01 * stored
assert last["material_dissipation"] > 0.1 * stored
assert abs(rest) < 5e-3 * stored  # most of it right after the cut

figure, axes = plt.subplots(figsize=(7.5, 3.5), layout="constrained")
for name in ("elastic", "kinetic", "friction_dissipation", "material_dissipation"):
    axes.plot(data[:, 0], 1e3 * data[:, 1 + ENERGY_COLUMNS.index(name)], label=name.replace("_", " "))
axes.set_xlabel("time [s]")
axes.set_ylabel("energy [mJ]")
axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
plt.show()
