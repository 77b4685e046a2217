"""Every setting of the simulator, with its unit and default: frozen, nested, validated.

Each stage reads only its own section. The sections are the tables of a scenario file.
``--set section.key=value`` can change every one of them.
"""

from __future__ import annotations

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, check_multiple, reject
from simloop.config.driving import (
    DriveConfig,
    MonitorConfig,
    RecoveryConfig,
    SeparationConfig,
    TrackerConfig,
    WatchdogConfig,
    check_braking,
)
from simloop.config.planning import PlannerConfig, SmootherConfig
from simloop.config.sensing import (
    CameraConfig,
    EkfConfig,
    EncoderConfig,
    ImuConfig,
    LidarConfig,
    LowObstaclesConfig,
    SlamConfig,
)
from simloop.config.simulation import (
    FrictionImage,
    FrictionZone,
    MotorConfig,
    PayloadConfig,
    RatesConfig,
    TracksConfig,
    VehicleConfig,
)

__all__ = [
    "MOVED_KEYS",
    "REMOVED_KEYS",
    "CameraConfig",
    "Config",
    "DriveConfig",
    "EkfConfig",
    "EncoderConfig",
    "FrictionImage",
    "FrictionZone",
    "ImuConfig",
    "LidarConfig",
    "LowObstaclesConfig",
    "MonitorConfig",
    "MotorConfig",
    "PayloadConfig",
    "PlannerConfig",
    "RatesConfig",
    "RecoveryConfig",
    "SeparationConfig",
    "SlamConfig",
    "SmootherConfig",
    "TrackerConfig",
    "TracksConfig",
    "VehicleConfig",
    "WatchdogConfig",
]


@dataclass(frozen=True, slots=True, config=STRICT)
class Config:
    """All settings except the scenario's own keys (arena, start, goal, ...)."""

    rates: RatesConfig = Field(default_factory=RatesConfig)
    vehicle: VehicleConfig = Field(default_factory=VehicleConfig)
    tracks: TracksConfig = Field(default_factory=TracksConfig)
    payload: PayloadConfig = Field(default_factory=PayloadConfig)
    motor: MotorConfig = Field(default_factory=MotorConfig)
    encoder: EncoderConfig = Field(default_factory=EncoderConfig)
    imu: ImuConfig = Field(default_factory=ImuConfig)
    lidar: LidarConfig = Field(default_factory=LidarConfig)
    camera: CameraConfig = Field(default_factory=CameraConfig)
    low_obstacles: LowObstaclesConfig = Field(default_factory=LowObstaclesConfig)
    ekf: EkfConfig = Field(default_factory=EkfConfig)
    slam: SlamConfig = Field(default_factory=SlamConfig)
    planner: PlannerConfig = Field(default_factory=PlannerConfig)
    smoother: SmootherConfig = Field(default_factory=SmootherConfig)
    tracker: TrackerConfig = Field(default_factory=TrackerConfig)
    drive: DriveConfig = Field(default_factory=DriveConfig)
    monitor: MonitorConfig = Field(default_factory=MonitorConfig)
    separation: SeparationConfig = Field(default_factory=SeparationConfig)
    recovery: RecoveryConfig = Field(default_factory=RecoveryConfig)
    watchdog: WatchdogConfig = Field(default_factory=WatchdogConfig)

    @model_validator(mode="after")
    def _limits_agree(self) -> Config:
        """What is counted on must be commanded: brakes of separation, speed of recovery."""
        drive = self.drive
        if self.separation.decel_mps2 > drive.max_brake_mps2:
            raise reject("separation.decel_mps2 is above drive.max_brake_mps2")
        check_braking(
            "drive.max_speed_mps",
            drive.max_speed_mps,
            "separation.decel_mps2",
            self.separation.decel_mps2,
        )
        if self.recovery.back_off_mps > drive.max_speed_mps:
            raise reject("recovery.back_off_mps is above drive.max_speed_mps")
        return self

    @model_validator(mode="after")
    def _camera_keeps_the_beat(self) -> Config:
        if self.camera.enabled:
            period, beat = self.camera.period_s, self.rates.control_s
            check_multiple("camera.period_s", period, "rates.control_s", beat)
            if period >= self.watchdog.image_s:
                raise reject(f"camera.period_s = {period:g} s is not below watchdog.image_s")
        return self


MOVED_KEYS = {
    **{
        f"tracker.{key}": f"drive.{key}"
        for key in (
            "max_speed_mps",
            "max_track_speed_mps",
            "max_yaw_rate_radps",
            "max_accel_mps2",
            "max_decel_mps2",
            "max_yaw_accel_radps2",
            "angle_gain_v_per_rad",
            "angle_error_limit_rad",
        )
    },
    "tracker.monitor_margin_m": "monitor.margin_m",
    "tracker.monitor_reaction_s": "monitor.reaction_s",
    "tracker.stuck_s": "recovery.stuck_s",
    "tracker.back_off_m": "recovery.back_off_m",
    "tracker.back_off_mps": "recovery.back_off_mps",
}
"""Old key -> present key. Older scenario files use the old keys; both are read."""

REMOVED_KEYS = {
    "low_obstacles.plane_m": "the LiDAR's height is read from the vehicle's model",
}
"""Keys of older scenario files that have no effect any more, each with the reason."""
