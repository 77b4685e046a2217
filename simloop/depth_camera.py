"""The simulated depth camera: a ray through the middle of every pixel, all at one instant."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from simloop.config import CameraConfig
from simloop.messages import DepthImage, FloatArray, pixel_slopes
from simloop.truth import RayFan, Truth


class DepthCamera:
    """Looks along the vehicle's x, level; base_from_camera: (3,) its place in base_link, m."""

    def __init__(
        self,
        config: CameraConfig,
        period_s: float,
        base_from_camera: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        self._config, self._rng, self._mount = config, rng, np.array(base_from_camera, np.float64)
        self._period_ns = round(period_s * 1e9)
        pixels = np.array([config.columns, config.rows])
        self._focal_px = 0.5 * pixels / np.tan(0.5 * np.array(config.fov_rad))
        aside, high = np.meshgrid(
            pixel_slopes(config.columns, self._focal_px[0]),
            pixel_slopes(config.rows, self._focal_px[1]),
        )
        rays = np.stack([np.ones_like(aside), aside, high], axis=-1).reshape(-1, 3)
        lengths = np.linalg.norm(rays, axis=1)
        self._rays, self._axial = rays / lengths[:, None], 1.0 / lengths
        self._cutoff_m = config.range_max_m * float(lengths.max())

    def shoot(self, truth: Truth, world: RayFan) -> DepthImage | None:
        """The image of ``truth``'s instant, if one is due then."""
        if truth.t_ns % self._period_ns:
            return None
        turn = Rotation.from_quat(truth.quaternion_wxyz[[1, 2, 3, 0]]).as_matrix()
        origin = truth.position_m + turn @ self._mount
        ranges = world.look(origin, self._rays @ turn.T, self._cutoff_m)
        return DepthImage(truth.t_ns, self._perceive(self._axial * ranges), self._focal_px.copy())

    def _perceive(self, true_m: FloatArray) -> np.ndarray:
        """(rows, cols) float32: noise that grows with the square, and pixels that stay empty."""
        config = self._config
        depth = true_m + config.noise_1pm * true_m**2 * self._rng.standard_normal(len(true_m))
        lost = self._rng.random(len(true_m)) < config.dropout
        out = (true_m < config.range_min_m) | (depth > config.range_max_m)
        depth[lost | out] = math.inf
        return depth.astype(np.float32).reshape(config.rows, config.columns)
