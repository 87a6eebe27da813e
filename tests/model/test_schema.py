"""Descriptions made in Python are checked field by field, as the files are."""

import dataclasses
from typing import Annotated

import numpy as np
from robots import BACKBONE, DISKS, LENGTH

from tdcr_fe import Backbone, Disks, Model, ParallelRouting, Robot, Tendon
from tdcr_fe.model.checks import size_contradictions
from tdcr_fe.model.messages import allowed
from tdcr_fe.model.schema import Keys, Quantity


def test_numbers_of_numpy_lists_and_whole_numbers_are_taken_and_kept_as_floats_and_tuples():
    backbone = Backbone(np.float64(1.0), np.float32(0.5), 1, 0, precurvature=np.array([0.0, 1.0]))
    robot = Robot(backbone, Disks([0.5, 1]), [Tendon("t1", ParallelRouting(0))])
    assert (backbone.length, backbone.precurvature) == (1.0, (0.0, 1.0))
    assert {type(x) for x in (backbone.length, backbone.radius, *robot.disks.positions)} == {float}
    assert hash(robot) == hash(dataclasses.replace(robot))


def test_memory_of_the_tangent_and_of_the_results_limits_mesh_and_steps():
    """In 0.1 a thousand elements a bay ended in a MemoryError, and ten thousand disks were silent for minutes."""
    rest = Model(elements_per_bay=1)
    for tendons, most in [((), 1407), ((Tendon("t1", ParallelRouting(4e-3)),), 1221)]:
        for count in (most, most + 1):
            robot = Robot(BACKBONE, Disks.equally_spaced(count, LENGTH), tendons)
            assert bool(size_contradictions(robot, rest)) == (count > most)
    robot = Robot(BACKBONE, DISKS)
    assert size_contradictions(robot, rest, 100_000) == []
    (found,) = size_contradictions(robot, rest, 10_000_000)
    assert (found.key, found.value) == ("steps", "10000000 steps")


def test_bounds_in_words():
    for bounds, text in [
        ({}, "a finite number [m]"),
        ({"gt": 0.0}, "a positive number [m]"),
        ({"ge": 0.0}, "a number [m], zero or more"),
        ({"gt": 0.0, "le": 3.0}, "a positive number [m], at most 3"),
        ({"gt": -1.0, "le": 0.5}, "a number [m], above -1, at most 0.5"),
        ({"ge": -2.0, "le": 2.0}, "a number [m] from -2 to 2"),
        ({"gt": 1.0}, "a number [m], above 1"),
    ]:
        keys = Keys({"x": Annotated[float, Quantity("", unit="m", **bounds)]})
        assert allowed(keys.json_schema["properties"]["x"]) == text
