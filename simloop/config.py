"""Every setting of the simulator, with its unit and default: frozen, nested, validated.

Each stage reads its own section and no other. The sections mirror the tables of a
scenario file; ``--set section.key=value`` reaches every one of them.
"""

from __future__ import annotations

from typing import Annotated, Literal

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
    check_multiple,
    check_range,
    has_area,
    reject,
)


@dataclass(frozen=True, slots=True, config=STRICT)
class RatesConfig:
    """Periods, s. Physics divides control; control divides the LiDAR's and the planner's.

    Encoders and IMU are read once a control period.
    """

    physics_s: Annotated[float, Field(ge=1e-6, le=0.01)] = 0.002
    control_s: Annotated[float, Field(ge=1e-6, le=0.1)] = 0.01
    lidar_s: Period = 0.1
    plan_s: Period = 1.83

    @model_validator(mode="after")
    def _periods_divide(self) -> RatesConfig:
        """Integer ratios, checked in whole nanoseconds: no period may drift against another."""
        pairs = (("control_s", "physics_s"), ("lidar_s", "control_s"), ("plan_s", "control_s"))
        for slow, fast in pairs:
            long_s, short_s = getattr(self, slow), getattr(self, fast)
            check_multiple(f"rates.{slow}", long_s, f"rates.{fast}", short_s)
        return self


Friction = Annotated[float, Field(gt=0.0, le=2.0)]


@dataclass(frozen=True, slots=True, config=STRICT)
class FrictionZone:
    """A rectangle of ground, min_m (x, y) to max_m (x, y) in map, with a friction of its own."""

    min_m: tuple[float, float]
    max_m: tuple[float, float]
    friction: Friction

    @model_validator(mode="after")
    def _has_area(self) -> FrictionZone:
        if not has_area(self.min_m, self.max_m):
            raise reject("tracks.zones: min_m must be below max_m in x and in y")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class FrictionImage:
    """A grey image laid over min_m to max_m (x, y in map), its upper edge at the largest y.

    file: PNG, relative to the scenario's file. black, white: the friction of these two, greys
    between them in proportion. Each place has its nearest pixel's friction.
    """

    file: str
    min_m: tuple[float, float]
    max_m: tuple[float, float]
    black: Friction
    white: Friction

    @model_validator(mode="after")
    def _has_area(self) -> FrictionImage:
        if not has_area(self.min_m, self.max_m):
            raise reject("tracks.friction_image: min_m must be below max_m in x and in y")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class TracksConfig:
    """Track-ground contact: isotropic Coulomb friction behind a shear brush.

    zones: where the ground's friction is another; where they overlap the last one holds. They lie
    over friction_image, and that over ``friction``.
    """

    friction: Friction = 0.6
    zones: tuple[FrictionZone, ...] = ()
    friction_image: FrictionImage | None = None
    shear_modulus_m: Positive = 0.001
    shear_damping_s: NonNegative = 0.01
    rolling_resistance: Annotated[float, Field(ge=0.0, le=0.5)] = 0.02


@dataclass(frozen=True, slots=True, config=STRICT)
class MotorConfig:
    """EMG49 (24 V, 49:1) behind an MD49 driver; all figures at the output shaft.

    brake_torque_nm: of a holding brake on each sprocket, which is not part of the EMG49: shorted
    motors and gear friction alone hold 0.5 N m each, a slope of 15 degrees.
    """

    supply_v: Positive = 24.0
    resistance_ohm: Positive = 24.0 / 13.0
    torque_nm_per_a: Positive = 1.57 / 1.6
    back_emf_v_per_radps: Positive = (24.0 - 0.5 * 24.0 / 13.0) / 14.975
    no_load_current_a: NonNegative = 0.5
    current_limit_a: Positive = 5.0
    brake_torque_nm: NonNegative = 6.0
    rotor_inertia_kgm2: Positive = 0.02


@dataclass(frozen=True, slots=True, config=STRICT)
class VehicleConfig:
    """The robot's body, as its own software knows it (Sabiha 2022, Table 3).

    It changes nothing of the plant, whose true measures stand in the vehicle's model.
    """

    gauge_m: Length = 0.39
    sprocket_radius_m: Length = 0.037
    length_m: Length = 0.49
    width_m: Length = 0.465
    footprint_offsets_m: tuple[float, float, float] = (-0.16, 0.0, 0.16)
    footprint_radius_m: Length = 0.25


@dataclass(frozen=True, slots=True, config=STRICT)
class PayloadConfig:
    """A load on the chassis of which the robot's software knows nothing; position in base_link."""

    mass_kg: Annotated[float, Field(ge=0.0, le=50.0)] = 0.0
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.15)


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
class PlannerConfig:
    """Sabiha 2022: J = w1 S + w2 Theta + sigma sum R; class of 100; 30 idle generations end it.

    squeeze_m: what may be given up of the safety distance where that saves a long way round.
    prefer_m: what a way has over it that is taken where it costs no more than prefer_share more.
    options: of the planner named, see `simloop.planners`.
    """

    name: str = "tlbo"
    length_weight: NonNegative = 0.65
    turning_weight: NonNegative = 0.35
    start_turn_weight: NonNegative = 0.1
    penalty: Positive = 60.0
    learners: Annotated[int, Field(ge=4, le=10_000)] = 100
    idle_generations: Annotated[int, Field(ge=1, le=10_000)] = 30
    max_evaluations: Annotated[int, Field(ge=100, le=10**8)] = 40_000
    safe_distance_m: Annotated[float, Field(ge=0.06, le=5.0)] = 0.26
    squeeze_m: Annotated[float, Field(ge=0.0, lt=0.05)] = 0.008
    prefer_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.02
    prefer_share: NonNegative = 0.05
    precise: bool = False
    latency: Literal["fixed", "per_evaluation"] = "fixed"
    latency_s: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    options: dict[str, bool | int | float | str] = Field(default_factory=dict)


@dataclass(frozen=True, slots=True, config=STRICT)
class SmootherConfig:
    """Bezier corners; the lead-in takes the path from the robot's heading to the plan's.

    extra_room_m: what the path keeps over the safety distance where there is room for it.
    """

    spacing_m: Annotated[float, Field(ge=0.001, le=1.0)] = 0.02
    max_cut_m: Length = 0.6
    min_cut_m: Length = 0.01
    extra_room_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.04
    lead_in_m: Length = 0.25
    lead_in_max_turn_rad: NonNegative = 1.0


@dataclass(frozen=True, slots=True, config=STRICT)
class TrackerConfig:
    """Velocity control along the path, the motors' speed loops, the collision monitor, recovery.

    Speed is limited by curvature (yaw rate, lateral acceleration), by clearance (creep_mps at the
    safety distance, full speed open_clearance_m further out) and by braking before the end.
    """

    max_speed_mps: Positive = 0.47
    max_track_speed_mps: Positive = 0.49
    max_yaw_rate_radps: Positive = 1.6
    max_accel_mps2: Positive = 0.8
    max_decel_mps2: Positive = 0.6
    max_yaw_accel_radps2: Positive = 6.0
    max_lateral_accel_mps2: Positive = 0.4
    creep_mps: Positive = 0.3
    open_clearance_m: Positive = 0.1
    lateral_gain_1pm2: Positive = 12.0
    heading_gain_1pm: Positive = 5.0
    turn_gain_1ps: Positive = 4.0
    turn_on_spot_rad: Positive = 0.8
    end_turn_rad: Positive = 0.15
    goal_margin_m: Positive = 0.03
    angle_gain_v_per_rad: NonNegative = 20.0
    angle_error_limit_rad: Positive = 0.3
    monitor_margin_m: NonNegative = 0.012
    monitor_reaction_s: NonNegative = 0.15
    stuck_s: Positive = 1.0
    back_off_m: Positive = 0.25
    back_off_mps: Positive = 0.12


@dataclass(frozen=True, slots=True, config=STRICT)
class WatchdogConfig:
    """What is too old to drive by.

    path_frames: frames of the planner (rates.plan_s) after which the robot stops on a path that
    no newer one has followed. estimate_s: by which the estimate may lag behind the robot's beat.
    image_s: without an image of the depth camera, where there is one.
    unheard_mps: speed while neither belt's counts are to be had.
    """

    path_frames: Annotated[float, Field(ge=1.0, le=1e6)] = 3.0
    estimate_s: Positive = 0.05
    image_s: Positive = 0.5
    unheard_mps: Positive = 0.15


@dataclass(frozen=True, slots=True, config=STRICT)
class Config:
    """The whole simulator but for the scenario's own facts (arena, start, goal)."""

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
    watchdog: WatchdogConfig = Field(default_factory=WatchdogConfig)

    @model_validator(mode="after")
    def _camera_keeps_the_beat(self) -> Config:
        if self.camera.enabled:
            period, beat = self.camera.period_s, self.rates.control_s
            check_multiple("camera.period_s", period, "rates.control_s", beat)
            if period >= self.watchdog.image_s:
                raise reject(f"camera.period_s = {period:g} s is not below watchdog.image_s")
        return self
