"""Settings of the sensors, of the estimator and of the maps."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    Angle,
    Fraction,
    Length,
    Period,
    Rate,
    Small,
    check_range,
    zero_or_enough,
)

# The filter multiplies and inverts squares of these: with a wider span they would be mere rounding.
Deviation = Annotated[float, Field(ge=1e-6, le=10.0)]
Walk = Annotated[float, Field(ge=1e-6, le=100.0)]
LogOdds = Annotated[float, Field(ge=1e-6, le=100.0)]
WalkOrZero = Annotated[float, Field(ge=0.0, le=100.0), AfterValidator(zero_or_enough)]


@dataclass(frozen=True, slots=True, config=STRICT)
class EncoderConfig:
    """Incremental encoders on both sprockets.

    Attributes:
        counts_per_turn: Counts of one turn of the sprocket.
    """

    counts_per_turn: Annotated[int, Field(gt=0, le=10**7)] = 980


@dataclass(frozen=True, slots=True, config=STRICT)
class ImuConfig:
    """MPU-9250: noise densities from its data sheet, bias after a start-up calibration.

    Attributes:
        gyro_noise_radps_rthz: White noise of the gyro, rad/s/sqrt(Hz).
        gyro_bias_radps: Standard deviation of its bias at the start, rad/s.
        gyro_bias_walk_radps_rts: Random walk of its bias, rad/s/sqrt(s).
        accel_noise_mps2_rthz: White noise of the accelerometer, m/s^2/sqrt(Hz).
        accel_bias_mps2: Standard deviation of its bias at the start, m/s^2.
        accel_bias_walk_mps2_rts: Random walk of its bias, m/s^2/sqrt(s).
    """

    gyro_noise_radps_rthz: Small = 1.75e-4
    gyro_bias_radps: Small = 3.0e-3
    gyro_bias_walk_radps_rts: Small = 2.0e-5
    accel_noise_mps2_rthz: Small = 2.9e-3
    accel_bias_mps2: Small = 0.05
    accel_bias_walk_mps2_rts: Small = 2.0e-4


@dataclass(frozen=True, slots=True, config=STRICT)
class LidarConfig:
    """A rotating LiDAR, like an RPLIDAR.

    Attributes:
        rays: Number of beams in one turn.
        range_min_m: Least range, m.
        range_max_m: Greatest range, m.
        noise_m: Standard deviation of a range, m.
        dropout: Share of the beams that are lost.
    """

    rays: Annotated[int, Field(ge=8, le=36000)] = 360
    range_min_m: Annotated[float, Field(ge=1e-3, le=100.0)] = 0.15
    range_max_m: Annotated[float, Field(ge=0.01, le=1000.0)] = 12.0
    noise_m: Small = 0.01
    dropout: Fraction = 0.005

    @model_validator(mode="after")
    def _range_opens(self) -> LidarConfig:
        check_range("lidar", self.range_min_m, self.range_max_m)
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class CameraConfig:
    """A forward depth camera, like an Intel RealSense D435; off unless ``enabled``.

    With a camera the robot turns before it drives: see ``tracker.turn_on_spot_with_camera_rad``
    and ``smoother.lead_in_max_turn_with_camera_rad``.

    Attributes:
        enabled: Whether the robot has a camera.
        period_s: Time from one image to the next, s.
        columns: Width of an image, pixels.
        rows: Height of an image, pixels.
        fov_rad: Horizontal and vertical field of view, rad.
        range_min_m: Least depth along the optical axis, m.
        range_max_m: Greatest depth, m.
        noise_1pm: Standard deviation over the squared depth, as for triangulation, 1/m.
        dropout: Share of the pixels that stay empty.
    """

    enabled: bool = False
    period_s: Period = 0.1
    columns: Annotated[int, Field(ge=4, le=4096)] = 64
    rows: Annotated[int, Field(ge=4, le=4096)] = 48
    fov_rad: tuple[Angle, Angle] = (1.518, 1.012)
    range_min_m: Annotated[float, Field(ge=1e-3, le=100.0)] = 0.17
    range_max_m: Annotated[float, Field(ge=0.01, le=100.0)] = 3.0
    noise_1pm: Small = 0.002
    dropout: Fraction = 0.01

    @model_validator(mode="after")
    def _range_opens(self) -> CameraConfig:
        check_range("camera", self.range_min_m, self.range_max_m)
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class EkfConfig:
    """The filter: process noise as densities (per square root of a second).

    The walk of the tracks' centres of rotation is per square root of a metre of belt.

    Attributes:
        speed_walk: Random walk of the speed, m/s.
        yaw_rate_walk: Random walk of the yaw rate, rad/s.
        lateral_walk: Random walk of the lateral position, m.
        gyro_bias_walk: Random walk of the gyro's bias, rad/s.
        gauge_ratio_walk: Random walk of the gauge ratio, per sqrt(m).
        gauge_ratio: Initial gauge ratio.
        gauge_ratio_std: Its standard deviation.
        icr_walk: Random walk of the centres of rotation, m per sqrt(m).
        icr_std_m: Their initial standard deviation, m.
        gyro_bias_std: Standard deviation of the gyro's bias after a start-up calibration, rad/s.
        encoder_slip_mps: Standard deviation of a belt speed measured by its encoder, m/s.
        map_std_xy_m: Error of a whole new view in the map, m, from one scan's fit and the size of
            the cells.
        map_std_yaw_rad: The same for the yaw, rad.
        gate_probability: Probability that a correct measurement passes the gate.
    """

    speed_walk: Walk = 0.1
    yaw_rate_walk: Walk = 1.0
    lateral_walk: Walk = 0.006
    gyro_bias_walk: WalkOrZero = 2.0e-5
    gauge_ratio_walk: WalkOrZero = 0.015
    gauge_ratio: Annotated[float, Field(ge=0.2, le=10.0)] = 1.2
    gauge_ratio_std: Deviation = 0.15
    icr_walk: WalkOrZero = 0.005
    icr_std_m: Deviation = 0.03
    gyro_bias_std: Deviation = 3.0e-3
    encoder_slip_mps: Deviation = 0.003
    map_std_xy_m: WalkOrZero = 0.0012
    map_std_yaw_rad: WalkOrZero = 0.0005
    gate_probability: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.9999


@dataclass(frozen=True, slots=True, config=STRICT)
class SlamConfig:
    """The occupancy grid and the scan matcher.

    Attributes:
        resolution_m: Size of a cell, m.
        hit_log_odds: Increment of a cell for a hit.
        miss_log_odds: Decrement of a cell for a beam that passes through it.
        max_log_odds: Bound of a cell's log-odds.
        occupied_log_odds: Log-odds above which a cell is occupied.
        search_xy_m: Half width of the search window, m.
        search_yaw_rad: Half width of the search window, rad.
        search_points: Number of points of a scan in the search.
        grain_m: Largest distance of a hit from its surface because of the cell size, m.
        refine_steps: Most steps of the refinement.
        least_overlap: Least share of the points that must match the map.
        most_residual: Largest mean squared residual of a valid match.
        match_std_xy_m: Standard deviation that the cell size adds to every fix, m.
        match_std_yaw_rad: The same for the yaw, rad.
        beyond_m: Distance past the goal in which waypoints may lie, m.
        prior_map: A map_server map (.yaml) that is known from the start, in its own resolution.
        extend_map: Whether observations are added to the map.
        max_cells: Largest number of cells of the map, at 34 bytes each (8 million cells of 5 cm:
            20 000 square metres, 270 MB).
    """

    resolution_m: Annotated[float, Field(ge=0.005, le=1.0)] = 0.05
    hit_log_odds: LogOdds = 0.9
    miss_log_odds: LogOdds = 0.4
    max_log_odds: LogOdds = 5.0
    occupied_log_odds: Annotated[float, Field(ge=0.0, le=1e3)] = 0.5
    search_xy_m: Annotated[float, Field(gt=0.0, le=2.0)] = 0.15
    search_yaw_rad: Annotated[float, Field(gt=0.0, le=3.2)] = 0.10
    search_points: Annotated[int, Field(ge=10, le=10_000)] = 90
    grain_m: Annotated[float, Field(ge=1e-4, le=1.0)] = 0.01
    refine_steps: Annotated[int, Field(ge=1, le=1000)] = 12
    least_overlap: Fraction = 0.4
    most_residual: Annotated[float, Field(ge=1e-3, le=1e6)] = 5.0
    match_std_xy_m: Deviation = 0.0005
    match_std_yaw_rad: Deviation = 0.00025
    beyond_m: Length = 0.5
    prior_map: str = ""
    extend_map: bool = True
    max_cells: Annotated[int, Field(ge=10_000, le=10**9)] = 8_000_000


@dataclass(frozen=True, slots=True, config=STRICT)
class LowObstaclesConfig:
    """Detection of obstacles in a depth image.

    Attributes:
        step_m: Least rise of an obstacle, m.
        slope: Least slope of the rise. Ramps are not obstacles.
        height_m: Greatest height over the ground that is in the robot's way, m.
        reach_m: Greatest distance at which obstacles are detected, m.
        clear_m: Distance up to which visible ground removes an obstacle that was there, m.
    """

    step_m: Annotated[float, Field(ge=1e-3, le=10.0)] = 0.025
    slope: Rate = 0.5
    height_m: Length = 0.25
    reach_m: Annotated[float, Field(ge=0.01, le=100.0)] = 2.5
    clear_m: Annotated[float, Field(ge=0.01, le=100.0)] = 1.0
