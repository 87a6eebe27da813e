"""A picture of a scene by Exudyn's own software renderer, which needs no window and no graphics card."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.rigidBodyUtilities import RotationMatrix2RotationVector
from numpy.typing import NDArray


def scene_picture(
    SC: exu.SystemContainer,
    center: Sequence[float],
    height: float,
    azimuth: float = -1.2,
    elevation: float = 0.4,
    size: tuple[int, int] = (900, 700),
) -> NDArray[np.uint8]:
    """Draw a scene in its current state; ``matplotlib.pyplot.imsave`` writes the picture, ``imshow`` shows it.

    Visualization settings of the container are changed: nodes, markers and loads are not shown, and a tendon is one
    line.

    Parameters
    ----------
    SC
        The container of the scene.
    center
        Point in the middle of the picture, world axes [m], shape (3,).
    height
        What is seen from bottom to top [m].
    azimuth, elevation
        Direction of the eye: angle from +x towards +y, and above the horizon [rad].
    size
        Width and height [pixels].

    Returns
    -------
    ndarray of uint8, shape (height, width, channels)
    """
    v: Any = SC.visualizationSettings
    v.view0.window.renderWindowSize = list(size)
    v.view0.scene.drawWorldBasis = True
    v.view0.scene.worldBasisSize = 0.15 * height
    v.view0.scene.drawCoordinateSystem = 0
    v.nodes.show = v.markers.show = v.loads.show = False
    v.connectors.springNumberOfWindings = v.connectors.curveTiling = 1  # a tendon is one line, not a coil
    v.openGL.lineWidth = 2.0
    v.raytracer.multiSampling = 3
    v.raytracer.numberOfThreads = 2
    v.raytracer.advanced.showText = False
    around, up = (np.cos(azimuth), np.sin(azimuth)), (np.cos(elevation), np.sin(elevation))
    back = np.array([around[0] * up[0], around[1] * up[0], up[1]])
    right = np.array([-around[1], around[0], 0.0])
    view = np.array([right, np.cross(back, right), back])
    SC.renderer.ZoomAll()
    SC.renderer.SetModelView(0.5 * height, RotationMatrix2RotationVector(view), list(view @ center))
    return np.asarray(SC.renderer.RedrawAndGetImage(useRaytracer=True))
