"""Mechanical components of a tendon-driven continuum robot in Exudyn: backbone, disks, tendons, friction, hooks.

The lowest layer: it depends on exudyn, numpy and scipy only, takes numbers and arrays, reads no files, prints nothing.
"""

import numpy as np
from numpy.typing import NDArray

#: Arrays of numbers, of truth values, and of whole numbers.
Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]
