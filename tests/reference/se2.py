"""Covariances of composed and inverted poses, to first order (Smith, Self and Cheeseman 1990), from the Jacobians."""

import numpy as np


def compose_covariance(pose_a_b, cov_a_b, pose_b_c, cov_b_c):
    """Return the covariance of compose(pose_a_b, pose_b_c), the two being independent."""
    first, second = np.asarray(pose_a_b), np.asarray(pose_b_c)
    cos, sin = np.cos(first[2]), np.sin(first[2])
    jacobian_first = np.eye(3)
    jacobian_first[0, 2] = -sin * second[0] - cos * second[1]
    jacobian_first[1, 2] = cos * second[0] - sin * second[1]
    jacobian_second = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    cov = jacobian_first @ cov_a_b @ jacobian_first.T + jacobian_second @ cov_b_c @ jacobian_second.T
    return 0.5 * (cov + cov.T)


def inverse_covariance(pose_a_b, cov_a_b):
    """Return the covariance of inverse(pose_a_b), to first order."""
    x, y, theta = np.asarray(pose_a_b)
    cos, sin = np.cos(theta), np.sin(theta)
    jacobian = np.array([[-cos, -sin, sin * x - cos * y], [sin, -cos, cos * x + sin * y], [0.0, 0.0, -1.0]])
    cov = jacobian @ cov_a_b @ jacobian.T
    return 0.5 * (cov + cov.T)
