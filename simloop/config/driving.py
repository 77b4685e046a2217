"""Settings of control: path tracking, drive, collision monitor, separation, recovery, watchdog."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    NonNegative,
    Positive,
    Rate,
    reject,
)

_LONGEST_BRAKING_S = 100.0  # how far ahead each velocity is examined grows with this time
Speed = Annotated[float, Field(ge=1e-3, le=20.0)]
YawRate = Annotated[float, Field(ge=1e-3, le=100.0)]
Acceleration = Annotated[float, Field(ge=0.01, le=1e3)]
YawAcceleration = Annotated[float, Field(ge=0.01, le=1e4)]


def check_braking(key: str, speed: float, brake_key: str, brake: float) -> None:
    """Check that a speed can be braked in a time for which it is worth looking ahead.

    Args:
        key: The key of the speed or of the yaw rate.
        speed: Its value, m/s or rad/s.
        brake_key: The key of the deceleration.
        brake: Its value, m/s^2 or rad/s^2.

    Raises:
        PydanticCustomError: If it takes longer.
    """
    if speed > _LONGEST_BRAKING_S * brake:
        raise reject(
            f"{key} = {speed:g} takes more than {_LONGEST_BRAKING_S:g} s to brake with "
            f"{brake_key} = {brake:g}"
        )


@dataclass(frozen=True, slots=True, config=STRICT)
class TrackerConfig:
    """Path tracking: the gains of the control law and the speed along the path.

    Speed is limited by curvature (yaw rate, lateral acceleration), by clearance (creep_mps at the
    safety distance, full speed open_clearance_m farther away) and by braking before the end.

    Attributes:
        max_lateral_accel_mps2: Largest centripetal acceleration in a bend, m/s^2.
        creep_mps: Speed where the path keeps exactly the safety distance, m/s.
        open_clearance_m: Clearance beyond the safety distance that allows full speed, m.
        lateral_gain_1pm2: Yaw rate per metre of lateral error and m/s of speed, 1/m^2.
        heading_gain_1pm: Yaw rate per radian of heading error and m/s of speed, 1/m.
        turn_gain_1ps: Yaw rate per radian of heading error in a turn on the spot, 1/s.
        turn_on_spot_rad: Heading error at which the robot stops and turns on the spot, rad.
        turn_on_spot_with_camera_rad: Replaces this limit while the depth camera is enabled, if it
            is smaller, rad. The camera sees low obstacles only ahead, so the robot turns to its
            new direction before it drives.
        end_turn_rad: Heading error at which a turn on the spot ends, rad.
        goal_margin_m: How far inside the goal's tolerance the robot stops, m.
    """

    max_lateral_accel_mps2: Rate = 0.4
    creep_mps: Rate = 0.3
    open_clearance_m: Rate = 0.1
    lateral_gain_1pm2: Rate = 12.0
    heading_gain_1pm: Rate = 5.0
    turn_gain_1ps: Rate = 4.0
    turn_on_spot_rad: Positive = 0.8
    turn_on_spot_with_camera_rad: Positive = 0.4
    end_turn_rad: Positive = 0.15
    goal_margin_m: Positive = 0.03


@dataclass(frozen=True, slots=True, config=STRICT)
class DriveConfig:
    """Limits of the commands to the tracks, and gains of the sprockets' speed control.

    Attributes:
        max_speed_mps: Largest forward or backward speed, m/s.
        max_track_speed_mps: Largest belt speed of one track, m/s.
        max_yaw_rate_radps: Largest yaw rate, rad/s.
        max_accel_mps2: Largest increase of speed, m/s^2.
        max_decel_mps2: Deceleration that path planning and the collision monitor assume, m/s^2.
        max_brake_mps2: Largest commanded deceleration, m/s^2. It is larger than the planned one,
            so there is room for correction.
        max_yaw_accel_radps2: Largest change of the yaw rate, rad/s^2.
        angle_gain_v_per_rad: Gain of the sprockets' angle error, V/rad.
        angle_error_limit_rad: Limit of the sprockets' angle error, rad (anti-windup).
    """

    max_speed_mps: Speed = 0.47
    max_track_speed_mps: Speed = 0.49
    max_yaw_rate_radps: YawRate = 1.6
    max_accel_mps2: Acceleration = 0.8
    max_decel_mps2: Acceleration = 0.6
    max_brake_mps2: Acceleration = 1.2
    max_yaw_accel_radps2: YawAcceleration = 6.0
    angle_gain_v_per_rad: NonNegative = 20.0
    angle_error_limit_rad: Positive = 0.3

    @model_validator(mode="after")
    def _brakes_as_planned(self) -> DriveConfig:
        if self.max_brake_mps2 < self.max_decel_mps2:
            raise reject("drive.max_brake_mps2 is below drive.max_decel_mps2")
        check_braking(
            "drive.max_speed_mps", self.max_speed_mps, "drive.max_decel_mps2", self.max_decel_mps2
        )
        check_braking(
            "drive.max_yaw_rate_radps",
            self.max_yaw_rate_radps,
            "drive.max_yaw_accel_radps2",
            self.max_yaw_accel_radps2,
        )
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class MonitorConfig:
    """The collision monitor: the robot can stop in time from each commanded velocity.

    Attributes:
        margin_m: Distance that the footprint keeps from observed obstacles, m. The step size along
            an arc uses up to 9 mm of it.
        reaction_s: Time for which a velocity is assumed to continue before braking begins, s.
        scans: Number of latest scans to remember.
        open_ground: Whether the ground is known to be open. Only then may the robot drive although
            its LiDAR has never measured anything.
    """

    margin_m: NonNegative = 0.012
    reaction_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.15
    scans: Annotated[int, Field(ge=1, le=100)] = 3
    open_ground: bool = False


@dataclass(frozen=True, slots=True, config=STRICT)
class SeparationConfig:
    """Separation from moving obstacles (ISO/TS 15066; passive safety, Macek et al. 2009).

    Attributes:
        margin_m: Distance to keep from a mover until the robot stands, m.
        decel_mps2: Deceleration that an emergency stop is assumed to have, m/s^2.
        grows_mps: Speed at which a mover's disc grows around its prediction, m/s.
        grows_share: Additional growth speed, as a share of the mover's speed.
        stands_mps: A slower mover is assumed to stand, m/s.
        stale_s: Age of the tracks after which the robot stops, s.
        horizon_s: Time over which encounters are predicted, s.
        threat_m: Predicted distance below which the robot looks for an evasive motion, m.
        worth_m: Distance that an evasive motion must gain over standing, m.
        comfort_m: Predicted distance that is large enough, m. Of the motions that keep it, the one
            nearest to the requested motion is selected.
        keep_s: Time for which an evasive motion is kept, s.
        restless_s: Time that a standing robot needs to drive off, s. It does not drive off while
            something that moved lately can reach it within this time.
        patience_s: Longest time of this wait, s.
        touch_patience_s: The same while something that moved lately may touch the robot, s.
        visit_memory_s: Time for which the robot remembers that a mover came within the margin, s.
            During this time it expects that movers may turn round and come back.
    """

    margin_m: NonNegative = 0.06
    decel_mps2: Acceleration = 1.0
    grows_mps: NonNegative = 0.1
    grows_share: NonNegative = 0.15
    stands_mps: Positive = 0.1
    stale_s: Positive = 0.6
    horizon_s: Annotated[float, Field(gt=0.0, le=60.0)] = 1.5
    threat_m: NonNegative = 0.10
    worth_m: NonNegative = 0.05
    comfort_m: NonNegative = 0.15
    keep_s: Positive = 0.3
    restless_s: NonNegative = 0.2
    patience_s: NonNegative = 1.2
    touch_patience_s: NonNegative = 3.0
    visit_memory_s: NonNegative = 10.0


@dataclass(frozen=True, slots=True, config=STRICT)
class RecoveryConfig:
    """Definition of being stuck, and the way in which the robot frees itself.

    Attributes:
        stuck_s: Time without progress after which the robot is stuck, s.
        back_off_m: Distance after which a recovery ends, m.
        back_off_mps: Speed of a recovery, m/s.
        attempts: Number of recoveries after which the robot gives up.
    """

    stuck_s: Positive = 1.0
    back_off_m: Positive = 0.25
    back_off_mps: Speed = 0.12
    attempts: Annotated[int, Field(ge=0, le=1000)] = 8


@dataclass(frozen=True, slots=True, config=STRICT)
class WatchdogConfig:
    """Age limits of the data that the robot drives by.

    Attributes:
        path_frames: Age limit of a path, in frames of the planner (``rates.plan_s``). The robot
            stops if there is no newer path.
        estimate_s: Largest delay of the estimate, s.
        image_s: Longest time without an image, if there is a depth camera, s.
        unheard_mps: Speed limit while neither belt's counts are available, m/s.
        slippery_mps: Speed limit on ground on which the robot has slid, m/s.
        thin_mps: Speed limit while many beams of the LiDAR do not come back, m/s.
    """

    path_frames: Annotated[float, Field(ge=1.0, le=1e6)] = 3.0
    estimate_s: Positive = 0.05
    image_s: Positive = 0.5
    unheard_mps: Rate = 0.15
    thin_mps: Rate = 0.15
    slippery_mps: Rate = 0.15
