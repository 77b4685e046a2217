"""Settings of control: path tracking, drive, collision monitor, separation, recovery, watchdog."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    NonNegative,
    Positive,
    reject,
)


@dataclass(frozen=True, slots=True, config=STRICT)
class TrackerConfig:
    """Path tracking: the gains of the control law and the speed along the path.

    Speed is limited by curvature (yaw rate, lateral acceleration), by clearance (creep_mps at the
    safety distance, full speed open_clearance_m further out) and by braking before the end.

    Attributes:
        max_lateral_accel_mps2: Largest centripetal acceleration in a bend, m/s^2.
        creep_mps: Speed where the path only just keeps the safety distance, m/s.
        open_clearance_m: Clearance beyond the safety distance that allows full speed, m.
        lateral_gain_1pm2: Yaw rate per metre of lateral error and m/s of speed, 1/m^2.
        heading_gain_1pm: Yaw rate per radian of heading error and m/s of speed, 1/m.
        turn_gain_1ps: Yaw rate per radian of heading error in a turn on the spot, 1/s.
        turn_on_spot_rad: Heading error at which the robot stops and turns on the spot, rad.
        turn_on_spot_with_camera_rad: The same limit while the depth camera is enabled, rad, if it
            is smaller. The camera sees some things only ahead, so the robot turns to where it
            will go before it goes there.
        end_turn_rad: Heading error at which a turn on the spot ends, rad.
        goal_margin_m: How far inside the goal's tolerance the robot stops, m.
    """

    max_lateral_accel_mps2: Positive = 0.4
    creep_mps: Positive = 0.3
    open_clearance_m: Positive = 0.1
    lateral_gain_1pm2: Positive = 12.0
    heading_gain_1pm: Positive = 5.0
    turn_gain_1ps: Positive = 4.0
    turn_on_spot_rad: Positive = 0.8
    turn_on_spot_with_camera_rad: Positive = 0.4
    end_turn_rad: Positive = 0.15
    goal_margin_m: Positive = 0.03


@dataclass(frozen=True, slots=True, config=STRICT)
class DriveConfig:
    """What the tracks may be asked for, and the loops that hold the sprockets' speeds.

    Attributes:
        max_speed_mps: Largest forward or backward speed, m/s.
        max_track_speed_mps: Largest belt speed of one track, m/s.
        max_yaw_rate_radps: Largest yaw rate, rad/s.
        max_accel_mps2: Largest increase of speed, m/s^2.
        max_decel_mps2: Deceleration that paths are planned with, and that the collision monitor
            counts on, m/s^2.
        max_brake_mps2: Largest deceleration that is commanded, m/s^2: more than what is planned
            with, so that there is room for correction.
        max_yaw_accel_radps2: Largest change of the yaw rate, rad/s^2.
        angle_gain_v_per_rad: Gain of the sprockets' angle error, V/rad.
        angle_error_limit_rad: Limit of the sprockets' angle error, rad (anti-windup).
    """

    max_speed_mps: Positive = 0.47
    max_track_speed_mps: Positive = 0.49
    max_yaw_rate_radps: Positive = 1.6
    max_accel_mps2: Positive = 0.8
    max_decel_mps2: Positive = 0.6
    max_brake_mps2: Positive = 1.2
    max_yaw_accel_radps2: Positive = 6.0
    angle_gain_v_per_rad: NonNegative = 20.0
    angle_error_limit_rad: Positive = 0.3

    @model_validator(mode="after")
    def _brakes_as_planned(self) -> DriveConfig:
        if self.max_brake_mps2 < self.max_decel_mps2:
            raise reject("drive.max_brake_mps2 is below drive.max_decel_mps2")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class MonitorConfig:
    """The collision monitor: from each commanded velocity the robot can stop in time.

    Attributes:
        margin_m: Distance that the footprint keeps from what has been seen, m. Up to 9 mm of it
            are taken by the steps in which an arc is examined.
        reaction_s: Time for which a velocity is taken to continue before braking begins, s.
        scans: Number of the latest scans that are remembered.
    """

    margin_m: NonNegative = 0.012
    reaction_s: NonNegative = 0.15
    scans: Annotated[int, Field(ge=1, le=100)] = 3


@dataclass(frozen=True, slots=True, config=STRICT)
class SeparationConfig:
    """Keeping apart from what moves (ISO/TS 15066; passive safety, Macek et al. 2009).

    Attributes:
        margin_m: Distance that is kept from a mover until the robot stands, m.
        decel_mps2: Deceleration of an emergency stop that is counted on, m/s^2.
        grows_mps: Speed at which a mover's disc grows about its prediction, m/s.
        grows_share: The same as a share of the mover's speed.
        stands_mps: A mover slower than this is taken to stand, m/s.
        stale_s: Age of the tracks after which the robot stands, s.
        horizon_s: How far ahead encounters are predicted, s.
        threat_m: A predicted distance below this is worth an evasive motion, m.
        worth_m: Predicted distance that an evasive motion must gain, m.
        comfort_m: Predicted distance beyond which more is worth nothing, m: of the motions that
            keep it, the one nearest to what is asked is taken.
        keep_s: How long an evasive motion is kept, s.
        restless_s: Time that a standing robot needs to get under way, s. It does not set off
            while something that moved lately can reach it within this time.
        patience_s: Longest time for which it waits so, s.
        visit_memory_s: Time for which the robot remembers that something that moves came within
            the margin, s. Until then it expects that things may turn round and come back.
    """

    margin_m: NonNegative = 0.06
    decel_mps2: Positive = 1.0
    grows_mps: NonNegative = 0.1
    grows_share: NonNegative = 0.3
    stands_mps: Positive = 0.1
    stale_s: Positive = 0.6
    horizon_s: Positive = 1.5
    threat_m: NonNegative = 0.10
    worth_m: NonNegative = 0.05
    comfort_m: NonNegative = 0.3
    keep_s: Positive = 0.3
    restless_s: NonNegative = 0.2
    patience_s: NonNegative = 3.0
    visit_memory_s: NonNegative = 10.0


@dataclass(frozen=True, slots=True, config=STRICT)
class RecoveryConfig:
    """What counts as being stuck, and how the robot frees itself.

    Attributes:
        stuck_s: Time without progress after which the robot is stuck, s.
        back_off_m: Distance after which a recovery ends, m.
        back_off_mps: Speed of a recovery, m/s.
        attempts: Recoveries after which the robot gives up.
    """

    stuck_s: Positive = 1.0
    back_off_m: Positive = 0.25
    back_off_mps: Positive = 0.12
    attempts: Annotated[int, Field(ge=0, le=1000)] = 8


@dataclass(frozen=True, slots=True, config=STRICT)
class WatchdogConfig:
    """What is too old to drive by.

    Attributes:
        path_frames: Frames of the planner (``rates.plan_s``) after which the robot stops on a path
            that no newer one has followed.
        estimate_s: Time by which the estimate may lag behind the robot's beat, s.
        image_s: Time without an image of the depth camera, where there is one, s.
        unheard_mps: Speed while neither belt's counts are to be had, m/s.
    """

    path_frames: Annotated[float, Field(ge=1.0, le=1e6)] = 3.0
    estimate_s: Positive = 0.05
    image_s: Positive = 0.5
    unheard_mps: Positive = 0.15
