"""Rotations and poses against scipy, the matrix exponential, and differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import poses

COMPONENT = st.floats(-1.7, 1.7)
TWIST = st.tuples(*[COMPONENT] * 6).map(np.array)


def matrix(xi: np.ndarray) -> np.ndarray:
    """Twist as a 4 x 4 matrix."""
    m = np.zeros((4, 4))
    m[:3, :3], m[:3, 3] = poses.skew(xi[3:]), xi[:3]
    return m


@settings(max_examples=60)
@given(st.tuples(COMPONENT, COMPONENT, COMPONENT).map(np.array))
def test_euler_parameters_are_scipys_quaternions(w):
    r = Rotation.from_rotvec(w)
    e = poses.euler_parameters_of_rotation(r.as_matrix())
    x, y, z, scalar = r.as_quat()
    q = np.array([scalar, x, y, z])
    assert min(np.linalg.norm(e - q), np.linalg.norm(e + q)) < 1e-14
    assert poses.rotation_of_euler_parameters(e) == pytest.approx(r.as_matrix(), abs=1e-14)


@settings(max_examples=60)
@given(TWIST, st.sampled_from([1.0, 1e-2, 1e-4, 1e-9]))
def test_exponential_is_the_matrix_exponential_and_the_logarithm_undoes_it(xi, scale):
    """For angles on both sides of the switch between series and closed form."""
    r, p = poses.exp_se3(scale * xi)
    whole = expm(matrix(scale * xi))
    assert r == pytest.approx(whole[:3, :3], abs=1e-14)
    assert p == pytest.approx(whole[:3, 3], abs=1e-14 * scale + 1e-16)
    assert poses.log_se3(r, p) == pytest.approx(scale * xi, abs=1e-13)


@settings(max_examples=40)
@given(TWIST, TWIST, st.sampled_from([(0.28, 1e-9), (0.85, 1e-6)]))
def test_inverse_tangent_against_differences(xi, change, case):
    """``d log(h exp(dx)) = T dx``; rotations up to half a radian, and up to one and a half."""
    size, tolerance = case
    xi = size * xi / max(np.linalg.norm(xi[3:]), 1.0)
    h = 1e-5

    def log(x):
        moved = expm(matrix(xi)) @ expm(matrix(x * change))
        return poses.log_se3(moved[:3, :3], moved[:3, 3])

    expected = (log(h) - log(-h)) / (2 * h)
    assert poses.inverse_tangent_se3(xi) @ change == pytest.approx(expected, abs=tolerance)
