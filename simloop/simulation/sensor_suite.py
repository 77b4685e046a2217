"""All simulated sensors of the robot as one unit that is read once per control period."""

from __future__ import annotations

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.messages import DepthImage, Readings
from simloop.physics.faults import Faults
from simloop.physics.plant import Plant
from simloop.sensors import DepthCamera, Encoders, Imu, Lidar
from simloop.simulation.environment import Goal
from simloop.simulation.random_streams import RandomStreams
from simloop.truth import RayFan, Truth


class SensorSuite:
    """Encoders, IMU, LiDAR, depth camera and goal reading, each at its own rate.

    Faults change the readings here, between the sensor and the robot.
    """

    def __init__(
        self,
        config: Config,
        plant: Plant,
        goal: Goal,
        faults: Faults,
        random: RandomStreams,
        profiler: Profiler,
    ) -> None:
        """Mount the sensors on the vehicle.

        Args:
            config: Sensor settings and rates.
            plant: The plant: it has the sensors' mounts, and rays are cast into its world.
            goal: The true goal.
            faults: The faults of the run.
            random: The random streams of the run.
            profiler: Times LiDAR and camera.
        """
        rates = config.rates
        self._plant, self._goal, self._faults = plant, goal, faults
        self._encoders = Encoders(config.encoder)
        self._imu = Imu(config.imu, rates.control_s, random.imu)
        lidar = Lidar(config.lidar, rates.lidar_s, plant.base_from_laser, random.lidar)
        self._sweep = profiler.wrap("lidar", lidar.sweep)
        self._rays = faults.rays(plant)
        self._shoot = _no_camera
        if config.camera.enabled:
            period_s, mount = config.camera.period_s, plant.base_from_camera
            camera = DepthCamera(config.camera, period_s, mount, random.camera)
            self._shoot = profiler.wrap("camera", camera.shoot)

    def read(self, before: Truth, truth: Truth) -> Readings:
        """Read every sensor that is due at the end of a control period.

        Args:
            before: Ground truth at the start of the period; the LiDAR sweeps from there.
            truth: Ground truth at the end of the period.

        Returns:
            The readings as the robot gets them, with faults applied.
        """
        faults, t_ns = self._faults, truth.t_ns
        faults.at(t_ns)
        return Readings(
            encoders=faults.encoders(self._encoders.read(truth)),
            imu=faults.imu(self._imu.read(truth)),
            scan=faults.scan(self._sweep(before, truth, self._rays), t_ns),
            goal=self._goal.read(t_ns),
            image=faults.image(self._shoot(truth, self._plant), t_ns),
        )


def _no_camera(truth: Truth, world: RayFan) -> DepthImage | None:
    """Replace the camera of a robot that has none."""
    return None
