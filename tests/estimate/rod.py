"""A simulated run of the rod: what is commanded, what acts, and where the nodes are."""

from dataclasses import replace

import numpy as np

from tdcr_fe.validation.campaigns import estimate as problem

problem.READINGS["angle"] = (["bending_angle"], (1.0,), 2e-3)
problem.READINGS["camera"] = (["position_x", "position_z"], (1.0,), 1e-4)


class Truth:
    def __init__(self, count, seed, *, friction=0.0, tension_sigma=0.01, at=0.25, force=None, **rest):
        self.drawn = drawn = problem.Drawn.of(friction, tension_sigma, count, seed, **rest)
        if force is not None:
            self.drawn = drawn = replace(drawn, forces=np.tile(force, (count, 1)))
        self.robot, self.tensions, self.forces = drawn.robot, drawn.tensions, drawn.forces
        self.steps = problem.solve_elements(self.robot, problem.model(friction), drawn.steps(at)).steps
        self.nodes, self.s = np.array([step.positions for step in self.steps]), self.steps[0].s

    def command(self, k):
        return self.drawn.step(self.drawn.commands, k)

    def read_as(self, kind, rng, k):
        """Readings of a kind of the campaign."""
        return problem.readings_of(kind, self.steps[k], self.robot.tendon_names, rng)

    def positions(self, rng, k, places=(problem.LENGTH,), sigma=1e-4):
        """Coordinates of markers at nodes, with noise; steps are numbered from 1."""
        found = []
        for s in places:
            found += problem.read(rng, self.nodes[k, np.argmin(np.abs(self.s - s))], s, sigma)
        return [replace(reading, step=k + 1) for reading in found]
