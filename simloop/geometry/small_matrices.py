"""Products of small matrices, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from simloop.messages import FloatArray


@njit(cache=True)
def squared_mahalanobis(residual: FloatArray, covariance: FloatArray) -> float:
    """r^T S^-1 r of an innovation (n,) with covariance (n, n)."""
    return float(np.dot(residual, np.linalg.solve(covariance, residual)))


@njit(cache=True)
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) a b of a (n, k) and b (k, m)."""
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
    """(n, n) a b a^T of a (n, k) and a symmetric b (k, k); a's zeros are left out."""
    return product(a, product(a, b).T)


@njit(cache=True)
def dot(a: FloatArray, b: FloatArray) -> float:
    """a . b, zeros of a left out."""
    total = 0.0
    for i in range(a.shape[0]):
        if a[i] != 0.0:
            total += a[i] * b[i]
    return total


@njit(cache=True)
def times(p: FloatArray, row: FloatArray) -> FloatArray:
    """(n,) p row of a symmetric p (n, n) and a row (n,) that is mostly zeros."""
    out = np.zeros(p.shape[0])
    for k in range(row.shape[0]):
        if row[k] != 0.0:
            for i in range(p.shape[0]):
                out[i] += p[k, i] * row[k]
    return out


@njit(cache=True)
def inverse_3(a: FloatArray) -> FloatArray:
    """The inverse of a symmetric, positive definite a (3, 3), by its cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m, n, o = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = a[k, n] * a[m, o] - a[k, o] * a[m, n]
    return out / (a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0])


@njit(cache=True)
def pair_mahalanobis(r: float, s: float, a: float, b: float, c: float) -> float:
    """Squared Mahalanobis distance of (r, s), of covariance [[a, b], [b, c]]."""
    return (c * r * r - 2.0 * b * r * s + a * s * s) / (a * c - b * b)
