"""Settings of the sensors, of the estimator and of the maps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    Angle,
    Fraction,
    Length,
    NonNegative,
    Period,
    Positive,
    check_range,
)


@dataclass(frozen=True, slots=True, config=STRICT)
class EncoderConfig:
    counts_per_turn: Annotated[int, Field(gt=0, le=10**7)] = 980


@dataclass(frozen=True, slots=True, config=STRICT)
class ImuConfig:
    """MPU-9250: noise densities from its data sheet, bias after a start-up calibration."""

    gyro_noise_radps_rthz: NonNegative = 1.75e-4
    gyro_bias_radps: NonNegative = 3.0e-3
    gyro_bias_walk_radps_rts: NonNegative = 2.0e-5
    accel_noise_mps2_rthz: NonNegative = 2.9e-3
    accel_bias_mps2: NonNegative = 0.05
    accel_bias_walk_mps2_rts: NonNegative = 2.0e-4


@dataclass(frozen=True, slots=True, config=STRICT)
class LidarConfig:
    rays: Annotated[int, Field(ge=8, le=36000)] = 360
    range_min_m: Positive = 0.15
    range_max_m: Annotated[float, Field(ge=0.01, le=1000.0)] = 12.0
    noise_m: NonNegative = 0.01
    dropout: Fraction = 0.005

    @model_validator(mode="after")
    def _range_opens(self) -> LidarConfig:
        check_range("lidar", self.range_min_m, self.range_max_m)
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class CameraConfig:
    """A forward depth camera, like an Intel RealSense D435; off unless ``enabled``.

    Depths are along the optical axis. noise_1pm: standard deviation over the squared depth, as
    triangulation has it.
    """

    enabled: bool = False
    period_s: Period = 0.1
    columns: Annotated[int, Field(ge=4, le=4096)] = 64
    rows: Annotated[int, Field(ge=4, le=4096)] = 48
    fov_rad: tuple[Angle, Angle] = (1.518, 1.012)
    range_min_m: Positive = 0.17
    range_max_m: Annotated[float, Field(ge=0.01, le=100.0)] = 3.0
    noise_1pm: NonNegative = 0.002
    dropout: Fraction = 0.01

    @model_validator(mode="after")
    def _range_opens(self) -> CameraConfig:
        check_range("camera", self.range_min_m, self.range_max_m)
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class EkfConfig:
    """Process noise as densities (per square root of a second), gates as probabilities.

    What the tracks' centres of rotation walk is per square root of a metre of belt:
    gauge_ratio_walk and, m, icr_walk. gyro_bias_std: what a start-up calibration leaves. map_std_*:
    with what error a whole new view enters the map, that of one scan's fit and of the cells' grain.
    """

    speed_walk: Positive = 0.1
    yaw_rate_walk: Positive = 1.0
    lateral_walk: Positive = 0.006
    gyro_bias_walk: NonNegative = 2.0e-5
    gauge_ratio_walk: NonNegative = 0.015
    gauge_ratio: Positive = 1.2
    gauge_ratio_std: Positive = 0.15
    icr_walk: NonNegative = 0.005
    icr_std_m: Positive = 0.03
    gyro_bias_std: Positive = 3.0e-3
    encoder_slip_mps: Positive = 0.003
    map_std_xy_m: NonNegative = 0.0012
    map_std_yaw_rad: NonNegative = 0.0005
    gate_probability: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.9999


@dataclass(frozen=True, slots=True, config=STRICT)
class SlamConfig:
    """Grid and scan matcher.

    grain_m: how far a hit may lie from its surface. least_overlap: share of the points that must
    meet the map. match_std_*: what the cells' grain adds to every fix. beyond_m: how far past the
    goal waypoints may lie. prior_map: a map_server map (.yaml) that is known from the beginning, in
    its own resolution; extend_map: whether what is seen is entered. max_cells: to which the map
    may grow, at 34 bytes each (8 million cells of 5 cm: 20 000 square metres, 270 MB).
    """

    resolution_m: Annotated[float, Field(ge=0.005, le=1.0)] = 0.05
    hit_log_odds: Positive = 0.9
    miss_log_odds: Positive = 0.4
    max_log_odds: Positive = 5.0
    occupied_log_odds: NonNegative = 0.5
    search_xy_m: Annotated[float, Field(gt=0.0, le=2.0)] = 0.15
    search_yaw_rad: Annotated[float, Field(gt=0.0, le=3.2)] = 0.10
    search_points: Annotated[int, Field(ge=10, le=10_000)] = 90
    grain_m: Positive = 0.01
    refine_steps: Annotated[int, Field(ge=1, le=1000)] = 12
    least_overlap: Fraction = 0.4
    most_residual: Positive = 5.0
    match_std_xy_m: Positive = 0.0005
    match_std_yaw_rad: Positive = 0.00025
    beyond_m: Length = 0.5
    prior_map: str = ""
    extend_map: bool = True
    max_cells: Annotated[int, Field(ge=10_000, le=10**9)] = 8_000_000


@dataclass(frozen=True, slots=True, config=STRICT)
class LowObstaclesConfig:
    """What in a depth image is in the robot's way.

    It rises by step_m or more, steeper than slope, to no more than height_m over the ground that
    the robot stands on, and is no farther than reach_m. clear_m: as far as ground that is seen
    tells that nothing stands there any more. plane_m: the LiDAR's height.
    """

    step_m: Positive = 0.025
    slope: Positive = 0.5
    height_m: Length = 0.25
    reach_m: Positive = 2.5
    clear_m: Positive = 1.0
    plane_m: Positive = 0.2
