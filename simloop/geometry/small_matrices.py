"""Multiply small matrices and skip the zeros of sparse ones (compiled)."""

from __future__ import annotations

import numpy as np
from numba import njit

from simloop.messages import FloatArray


@njit(cache=True)
def squared_mahalanobis(residual: FloatArray, covariance: FloatArray) -> float:
    """Compute the squared Mahalanobis distance r^T S^-1 r of an innovation.

    Args:
        residual: (n,) innovation r.
        covariance: (n, n) covariance S of the innovation.

    Returns:
        The squared Mahalanobis distance.
    """
    return float(np.dot(residual, np.linalg.solve(covariance, residual)))


@njit(cache=True)
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Compute a b, skipping the zeros of a.

    Args:
        a: (n, k).
        b: (k, m).

    Returns:
        (n, m) the product.
    """
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]
    return out


@njit(cache=True)
def sandwich(a: FloatArray, b: FloatArray) -> FloatArray:
    """Compute a b a^T, skipping the zeros of a.

    Args:
        a: (n, k).
        b: (k, k), symmetric.

    Returns:
        (n, n) the product.
    """
    return product(a, product(a, b).T)


@njit(cache=True)
def dot(a: FloatArray, b: FloatArray) -> float:
    """Compute the scalar product a . b, skipping the zeros of a.

    Args:
        a: (n,).
        b: (n,).

    Returns:
        The scalar product.
    """
    total = 0.0
    for i in range(a.shape[0]):
        if a[i] != 0.0:
            total += a[i] * b[i]
    return total


@njit(cache=True)
def times(p: FloatArray, row: FloatArray) -> FloatArray:
    """Compute the product p row for a row that is mostly zeros.

    Args:
        p: (n, n), symmetric.
        row: (n,).

    Returns:
        (n,) the product.
    """
    out = np.zeros(p.shape[0])
    for k in range(row.shape[0]):
        if row[k] != 0.0:
            for i in range(p.shape[0]):
                out[i] += p[k, i] * row[k]
    return out


@njit(cache=True)
def inverse_3(a: FloatArray) -> FloatArray:
    """Invert a 3 x 3 matrix by its cofactors.

    Args:
        a: (3, 3), symmetric and positive definite.

    Returns:
        (3, 3) the inverse.
    """
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m, n, o = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = a[k, n] * a[m, o] - a[k, o] * a[m, n]
    return out / (a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0])


@njit(cache=True)
def pair_mahalanobis(r: float, s: float, a: float, b: float, c: float) -> float:
    """Compute the squared Mahalanobis distance of two values.

    Args:
        r: First value.
        s: Second value.
        a: Variance of the first value.
        b: Covariance of the two values.
        c: Variance of the second value.

    Returns:
        [r, s] [[a, b], [b, c]]^-1 [r, s]^T; infinite if that matrix has no inverse.
    """
    determinant = a * c - b * b
    if determinant == 0.0:
        return np.inf
    return (c * r * r - 2.0 * b * r * s + a * s * s) / determinant
