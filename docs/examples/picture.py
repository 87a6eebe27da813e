"""Draw a scene with Exudyn's own software renderer, which needs no window and no graphics card."""

from collections.abc import Sequence

import exudyn as exu
import matplotlib.pyplot as plt
import numpy as np
from exudyn.rigidBodyUtilities import RotationMatrix2RotationVector


def save_picture(
    SC: exu.SystemContainer,
    path: str,
    center: Sequence[float],
    height: float,
    azimuth: float,
    elevation: float = 0.4,
) -> None:
    """Write the scene in its current state as PNG.

    Parameters
    ----------
    SC
        The container of the scene.
    path
        Of the picture.
    center
        Point in the middle of the picture [m].
    height
        What is seen from bottom to top [m].
    azimuth, elevation
        Where the eye stands: angle from +x towards +y, and above the horizon [rad].
    """
    v = SC.visualizationSettings
    v.view0.window.renderWindowSize = (900, 700)
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
    plt.imsave(path, SC.renderer.RedrawAndGetImage(useRaytracer=True))
