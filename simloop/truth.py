"""What the simulator knows and the robot must never see: ground truth and ray casters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from simloop.messages import BaseMessage, FloatArray, Message


@dataclass(frozen=True, slots=True, eq=False)
class Truth(BaseMessage):
    """The physical state of the robot, for sensors, metrics and recorder.

    Attributes:
        t_ns: instant, ns.
        pose_xyyaw: (3,) base_link in map, m, m, rad.
        position_m: (3,) origin of base_link in the world, m.
        quaternion_wxyz: (4,) world_from_base.
        velocity_body: (6,) linear, m/s, then angular, rad/s, in base_link.
        acceleration_mps2: (3,) proper acceleration at the model's site ``imu``, in base_link's
            axes, mean over the last control period, as an ideal accelerometer there measures it.
        sprocket_rad: (2,) angles, left and right.
        sprocket_radps: (2,) rates, left and right.
        motor_current_a: (2,) left and right.
        motor_voltage_v: (2,) left and right.
        energy_j: electrical energy drawn from the battery since the start.
        contact_count: number of contacts with obstacles that began so far.
        in_contact: whether the vehicle touches an obstacle now.
        hit_count: contacts that began while the vehicle stood with its motors off. They are not
            in ``contact_count``.
        unstable: why the physics cannot be believed any more; empty while it can.
    """

    t_ns: int
    pose_xyyaw: FloatArray
    position_m: FloatArray
    quaternion_wxyz: FloatArray
    velocity_body: FloatArray
    acceleration_mps2: FloatArray
    sprocket_rad: FloatArray
    sprocket_radps: FloatArray
    motor_current_a: FloatArray
    motor_voltage_v: FloatArray
    energy_j: float
    contact_count: int
    in_contact: bool
    hit_count: int = 0
    unstable: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class TrackTruth(BaseMessage):
    """The true state of the tracks, to test an estimator against.

    Attributes:
        t_ns: instant, ns.
        slip_mps: (2,) left and right: speed of the belt's surface over the ground along the
            vehicle, mean of the wheels by load; negative if the belt drives.
        icr_m: (3,) instantaneous centres of rotation in base_link: y of the left track, y of the
            right track, x of the vehicle; NaN if the vehicle hardly turns.
        wheel_load_n: (wheels,) front to rear, left before right.
        shear_work_j: energy lost to shear between tracks and ground since the start.
    """

    t_ns: int
    slip_mps: FloatArray
    icr_m: FloatArray
    wheel_load_n: FloatArray
    shear_work_j: float


@dataclass(frozen=True, slots=True, eq=False)
class LooseTruth(BaseMessage):
    """The true poses of things that can move.

    Attributes:
        t_ns: instant, ns.
        bodies: (n,) their names, in the model's order.
        position_m: (n, 3) origins of the bodies in the world, m.
        quaternion_wxyz: (n, 4) world_from_body.
    """

    t_ns: int
    bodies: tuple[str, ...]
    position_m: FloatArray
    quaternion_wxyz: FloatArray


Published = Message | Truth | TrackTruth | LooseTruth
"""All messages that a listener gets: the robot's messages and the ground truth."""


class RayCaster(Protocol):
    """A world as a LiDAR measures it."""

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Measure the ranges of the rays of one control period.

        Args:
            origins_m: (n, 3) in the world, m, millimetres apart.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        ...


class RayFan(Protocol):
    """A world as a camera measures it."""

    def look(self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Measure the ranges of rays from one origin.

        Args:
            origin_m: (3,) in the world, m.
            directions: (n, 3) unit vectors in the world.
            cutoff_m: longest range, m.

        Returns:
            (n,) ranges, m; -1 where a ray hits nothing within the cutoff.
        """
        ...
