"""A simulated run of the rod: what is commanded, what acts, and where the nodes are."""

from dataclasses import replace

import numpy as np

from tdcr_fe.validation.campaigns.estimate import LENGTH, Drawn, model, read, solve_elements


class Truth:
    def __init__(self, count, seed, *, friction=0.0, tension_sigma=0.01, at=LENGTH, force=None, **rest):
        self.drawn = drawn = Drawn.of(friction, tension_sigma, count, seed, **rest)
        if force is not None:
            self.drawn = drawn = replace(drawn, forces=np.tile(force, (count, 1)))
        self.robot, self.tensions, self.forces = drawn.robot, drawn.tensions, drawn.forces
        steps = solve_elements(self.robot, model(friction), drawn.steps(at)).steps
        self.nodes, self.s = np.array([step.positions for step in steps]), steps[0].s

    def command(self, k):
        return self.drawn.step(self.drawn.commands, k)

    def positions(self, rng, k, places=(LENGTH,), sigma=1e-4):
        """Coordinates of markers at nodes, with noise; steps are numbered from 1."""
        found = []
        for s in places:
            found += read(rng, self.nodes[k, np.argmin(np.abs(self.s - s))], s, sigma)
        return [replace(reading, step=k + 1) for reading in found]
