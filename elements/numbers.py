"""Numbers of nodes and unknowns as slices, by which numpy needs no copies; the largest of a few numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable, compiled_as

Array = NDArray[np.float64]
Index = NDArray[np.int_]


def as_slice(numbers: Index) -> slice | Index:
    """The same numbers as a slice, where they are evenly spaced."""
    if len(numbers) < 2:
        return slice(int(numbers[0]), int(numbers[0]) + 1) if len(numbers) else slice(0, 0)
    steps = np.diff(numbers)
    if steps[0] > 0 and np.all(steps == steps[0]):
        return slice(int(numbers[0]), int(numbers[-1]) + 1, int(steps[0]))
    return numbers


@compiled_as(lambda values: values.max())
def largest(values: Array) -> float:
    """The largest of some numbers; a fifth of the time of numpy's ``max`` for a few of them."""
    return values.item(values.argmax())


@compiled_as(lambda values: values.min())
def smallest(values: Array) -> float:
    """The smallest of some numbers, see `largest`."""
    return values.item(values.argmin())


@compilable
def largest_magnitude(values: Array) -> float:
    """The largest magnitude of some numbers, see `largest`."""
    return largest(np.abs(values))
