"""The simulated sensors: turn the ground truth into what the real sensors would measure.

There are encoders, an IMU like the MPU-9250, a rotating LiDAR whose beams are cast while the robot
moves, and a depth camera. Each sensor has its own random generator, so one sensor's settings do not
change another's noise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from simloop.config import CameraConfig, EncoderConfig, ImuConfig, LidarConfig
from simloop.messages import (
    DepthImage,
    EncoderReading,
    FloatArray,
    ImuReading,
    LidarScan,
    pixel_slopes,
)
from simloop.truth import RayCaster, RayFan, Truth

_TURN = 2.0 * math.pi
_DRAWS = 100  # IMU readings whose noise is drawn at once


class Encoders:
    """Quadrature encoders on both sprockets: cumulative, quantised counts."""

    def __init__(self, config: EncoderConfig) -> None:
        """Set the resolution.

        Args:
            config: number of counts in one turn of the sprocket.
        """
        self._counts_per_rad = config.counts_per_turn / _TURN

    def read(self, truth: Truth) -> EncoderReading:
        """Read the counts.

        Args:
            truth: the robot's state now.

        Returns:
            Counts since angle 0, rounded down.
        """
        left, right = truth.sprocket_rad.tolist()
        scale = self._counts_per_rad
        return EncoderReading(truth.t_ns, math.floor(left * scale), math.floor(right * scale))


class Imu:
    """Gyro and accelerometer with white noise and a random-walk bias."""

    def __init__(self, config: ImuConfig, period_s: float, rng: np.random.Generator) -> None:
        """Draw the initial bias.

        Args:
            config: noise densities and biases.
            period_s: time between two readings, s.
            rng: random generator of the noise and the biases.
        """
        self._rng = rng
        # White noise of density d in units/sqrt(Hz), averaged over a period T, has a standard
        # deviation of d / sqrt(T). A random walk w in units/sqrt(s) has steps of w sqrt(T).
        white, walk = 1.0 / math.sqrt(period_s), math.sqrt(period_s)

        def six(gyro: float, accel: float) -> FloatArray:
            return np.repeat([gyro, accel], 3)

        noise = white * six(config.gyro_noise_radps_rthz, config.accel_noise_mps2_rthz)
        steps = walk * six(config.gyro_bias_walk_radps_rts, config.accel_bias_walk_mps2_rts)
        bias = six(config.gyro_bias_radps, config.accel_bias_mps2)
        self._steps, self._noise = steps, noise
        self._biases = (bias * rng.standard_normal(6))[None]
        self._errors, self._drawn = np.empty((0, 2, 3)), 0

    @property
    def bias(self) -> FloatArray:
        """(6,) bias of gyro, rad/s, and accelerometer, m/s^2, at the last reading."""
        return self._biases[self._drawn]

    def read(self, truth: Truth) -> ImuReading:
        """Read rates and proper acceleration.

        Args:
            truth: the robot's state now.

        Returns:
            Rates, rad/s, and proper acceleration, m/s^2, in the imu frame, whose axes are
            base_link's.
        """
        if self._drawn == len(self._errors):
            self._draw()
        gyro, accel = self._errors[self._drawn]
        self._drawn += 1
        return ImuReading(
            truth.t_ns, truth.velocity_body[3:] + gyro, truth.acceleration_mps2 + accel
        )

    def _draw(self) -> None:
        """Draw the errors of many readings at once. This costs less than drawing one by one."""
        drawn = self._rng.standard_normal((_DRAWS, 2, 6))
        self._biases = np.cumsum(
            np.concatenate((self.bias[None], self._steps * drawn[:, 0])), axis=0
        )
        errors = self._biases[1:] + self._noise * drawn[:, 1]
        self._errors, self._drawn = errors.reshape(_DRAWS, 2, 3), 0


class _Part(NamedTuple):
    """The beams of a turn that belong to one control period, as views into the turn's arrays.

    Attributes:
        since_ns: start of the period, counted from the turn's start.
        last: number of the first beam after the period.
        fractions: (n,) fraction of the period at each beam, 0 to 1.
        angles: (n,) in the laser frame, rad.
        origins: (n, 3) in the world, m.
        directions: (n, 3) unit vectors in the world.
        ranges: (n,) m.
    """

    since_ns: int
    last: int
    fractions: FloatArray
    angles: FloatArray
    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray


class Lidar:
    """A rotating laser. Each beam is cast from the vehicle's pose at the beam's instant."""

    def __init__(
        self,
        config: LidarConfig,
        period_s: float,
        base_from_laser: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        """Compute the angles and times of a turn's beams.

        Args:
            config: number of beams, range and noise.
            period_s: time of one turn, s.
            base_from_laser: (3,) position of the laser in base_link, m; its axes are base_link's.
            rng: random generator of the noise and the drop-outs.
        """
        self._config, self._rng = config, rng
        self._mount = np.ascontiguousarray(base_from_laser)
        self._period_ns = round(period_s * 1e9)
        steps = np.arange(1, config.rays + 1)
        self._angles = -math.pi + _TURN * steps / config.rays
        self._due_ns = steps * self._period_ns // config.rays  # since the turn's start
        self._age_ns = self._period_ns - self._due_ns
        self._ranges = np.empty(config.rays)
        self._origins = np.empty((config.rays, 3))
        self._directions = np.empty((config.rays, 3))
        self._next = 0
        self._parts: dict[tuple[int, int], _Part] = {}

    def sweep(self, before: Truth, now: Truth, world: RayCaster) -> LidarScan | None:
        """Cast the beams that fall between two instants.

        Args:
            before: the robot's state one control period ago.
            now: its state now.
            world: the world that the beams hit.

        Returns:
            The scan if its turn ends now, else None.
        """
        start_ns = before.t_ns - before.t_ns % self._period_ns
        if self._due_ns[self._next] > now.t_ns - start_ns:
            return None  # the laser turns so slowly, or has so few beams, that none is due
        part = self._part(before.t_ns - start_ns, now.t_ns - start_ns)
        origins, directions = part.origins, part.directions
        beam_rays(
            before.position_m,
            before.quaternion_wxyz,
            now.position_m,
            now.quaternion_wxyz,
            part.fractions,
            part.angles,
            self._mount,
            origins,
            directions,
        )
        part.ranges[:] = world.cast(origins, directions, self._config.range_max_m)
        self._next = part.last
        if part.last < self._config.rays:
            return None
        self._next = 0
        return LidarScan(
            now.t_ns,
            self._angles.copy(),
            self._perceive(),
            self._age_ns.copy(),
            self._config.range_min_m,
            self._config.range_max_m,
        )

    def _part(self, since_ns: int, until_ns: int) -> _Part:
        """Find the beams from the next one until an instant of the turn. Cache them for reuse."""
        key = (self._next, until_ns)
        part = self._parts.get(key)
        if part is None or part.since_ns != since_ns:
            last = int(self._due_ns.searchsorted(until_ns, side="right"))
            beams = slice(self._next, last)
            part = self._parts[key] = _Part(
                since_ns,
                last,
                (self._due_ns[beams] - since_ns) / (until_ns - since_ns),
                self._angles[beams],
                self._origins[beams],
                self._directions[beams],
                self._ranges[beams],
            )
        return part

    def _perceive(self) -> FloatArray:
        """Compute the ranges (rays,) with noise, m; inf for drop-outs and beyond the limits."""
        config, rays = self._config, self._config.rays
        ranges = self._ranges + config.noise_m * self._rng.standard_normal(rays)
        lost = self._rng.random(rays) < config.dropout
        out = (self._ranges < config.range_min_m) | (ranges > config.range_max_m)
        ranges[lost | out] = np.inf
        return ranges


@njit(cache=True)
def beam_rays(
    position_0: FloatArray,
    quaternion_0: FloatArray,
    position_1: FloatArray,
    quaternion_1: FloatArray,
    fraction: FloatArray,
    angle: FloatArray,
    mount: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
) -> None:
    """Compute the beams of a laser whose body moves from pose 0 to pose 1.

    The position is interpolated linearly, and the attitude by normalised linear interpolation of
    the quaternion. That is accurate over one control period.

    Args:
        position_0: (3,) of base_link in the world, m.
        quaternion_0: (4,) w, x, y, z, world_from_base.
        position_1: (3,) as position_0, at the end.
        quaternion_1: (4,) as quaternion_0, at the end.
        fraction: (n,) fraction of the motion at each beam, 0 to 1.
        angle: (n,) angles of the beams in the laser frame, rad.
        mount: (3,) position of the laser in base_link, m.
        origins: (n, 3) in the world, m; written.
        directions: (n, 3) unit vectors in the world; written.
    """
    for i in range(angle.shape[0]):
        # The attitude at the beam's instant, and its rotation matrix row by row. The factor s
        # corrects for the length of the interpolated quaternion.
        f = fraction[i]
        w = quaternion_0[0] + f * (quaternion_1[0] - quaternion_0[0])
        x = quaternion_0[1] + f * (quaternion_1[1] - quaternion_0[1])
        y = quaternion_0[2] + f * (quaternion_1[2] - quaternion_0[2])
        z = quaternion_0[3] + f * (quaternion_1[3] - quaternion_0[3])
        s = 2.0 / (w * w + x * x + y * y + z * z)
        c, d = math.cos(angle[i]), math.sin(angle[i])
        rows = (
            (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
            (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
            (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
        )
        # The laser turns about base_link's z, so a beam has no component along it.
        for k in range(3):
            a, b, e = rows[k]
            at = position_0[k] + f * (position_1[k] - position_0[k])
            origins[i, k] = at + a * mount[0] + b * mount[1] + e * mount[2]
            directions[i, k] = a * c + b * d


class DepthCamera:
    """A depth camera that looks horizontally along the vehicle's x."""

    def __init__(
        self,
        config: CameraConfig,
        period_s: float,
        base_from_camera: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        """Compute the rays of the pixels.

        Args:
            config: resolution, field of view, range and noise.
            period_s: time between two images, s; a multiple of the control period.
            base_from_camera: (3,) position of the camera in base_link, m.
            rng: random generator of the noise and the empty pixels.
        """
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
        """Take an image, if one is due.

        Args:
            truth: the robot's state now.
            world: the world that the rays hit.

        Returns:
            The image, or None between two images.
        """
        if truth.t_ns % self._period_ns:
            return None
        turn = Rotation.from_quat(truth.quaternion_wxyz[[1, 2, 3, 0]]).as_matrix()
        origin = truth.position_m + turn @ self._mount
        ranges = world.look(origin, self._rays @ turn.T, self._cutoff_m)
        return DepthImage(truth.t_ns, self._perceive(self._axial * ranges), self._focal_px.copy())

    def _perceive(self, true_m: FloatArray) -> np.ndarray:
        """Compute noisy depths (rows, columns), float32, m; inf: empty. Noise grows as depth^2."""
        config = self._config
        depth = true_m + config.noise_1pm * true_m**2 * self._rng.standard_normal(len(true_m))
        lost = self._rng.random(len(true_m)) < config.dropout
        out = (true_m < config.range_min_m) | (depth > config.range_max_m)
        depth[lost | out] = math.inf
        return depth.astype(np.float32).reshape(config.rows, config.columns)
