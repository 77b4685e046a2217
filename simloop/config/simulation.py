"""Settings of the simulated world and vehicle: periods, ground, motors, body, load."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    Length,
    NonNegative,
    Period,
    Positive,
    check_multiple,
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

    sprocket_radius_m is the plant's too; all else of the plant stands in the vehicle's model.
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
