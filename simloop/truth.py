"""What the simulator knows and the robot must never see: ground truth and ray casters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from simloop.messages import BaseMessage, FloatArray, Message


@dataclass(frozen=True, slots=True, eq=False)
class Truth(BaseMessage):
    """What the plant knows and the robot must not: for sensors, metrics and recorder.

    pose_xyyaw: (3,) base_link in map, m, m, rad.
    position_m: (3,) base_link origin in the world; quaternion_wxyz: (4,).
    velocity_body: (6,) linear m/s then angular rad/s, in base_link.
    acceleration_mps2: (3,) proper acceleration at the model's site ``imu``, in base_link's axes,
        mean over the last control period: what an ideal accelerometer there reads.
    sprocket_rad, sprocket_radps: (2,) left, right.
    motor_current_a, motor_voltage_v: (2,) left, right.
    energy_j: electrical energy drawn from the battery since the start.
    contact_count: touches of the vehicle with anything but the ground, counted at their onset.
    in_contact: whether it touches anything but the ground now.
    hit_count: touches that began while it stood with its motors off, which are no contact_count.
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


@dataclass(frozen=True, slots=True, eq=False)
class TrackTruth(BaseMessage):
    """What the tracks truly do, for whoever tests an estimator; the robot must not know it.

    slip_mps: (2,) left, right, speed of the belt's surface over the ground along the vehicle, the
    wheels' mean by load; negative: it drives. icr_m: (3,) y of the left and of the right track's
    instantaneous centre of rotation, x of the vehicle's, in base_link; NaN where it hardly turns.
    wheel_load_n: (wheels,) front to rear, left before right. shear_work_j: what the shear between
    tracks and ground has taken since the start.
    """

    t_ns: int
    slip_mps: FloatArray
    icr_m: FloatArray
    wheel_load_n: FloatArray
    shear_work_j: float


@dataclass(frozen=True, slots=True, eq=False)
class LooseTruth(BaseMessage):
    """Where things that can move truly are; bodies: (n,) their names, in the model's order.

    position_m: (n, 3) of their centres in the world; quaternion_wxyz: (n, 4).
    """

    t_ns: int
    bodies: tuple[str, ...]
    position_m: FloatArray
    quaternion_wxyz: FloatArray


Published = Message | Truth | TrackTruth | LooseTruth
"""Everything that a listener hears: the robot's messages and the ground truth."""


class RayCaster(Protocol):
    """What a LiDAR needs of the world."""

    def cast(self, origins_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Ranges (n,) along unit ``directions`` (n, 3) from ``origins_m`` (n, 3); -1: nothing."""
        ...


class RayFan(Protocol):
    """What a camera needs of the world."""

    def look(self, origin_m: FloatArray, directions: FloatArray, cutoff_m: float) -> FloatArray:
        """Ranges (n,) along unit ``directions`` (n, 3) from ``origin_m`` (3,); -1: nothing."""
        ...
