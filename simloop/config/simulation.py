"""Settings of the simulated world and vehicle: periods, ground, motors, body, load."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import (
    STRICT,
    Length,
    NonNegative,
    Offset,
    Period,
    Point,
    Scale,
    Small,
    check_multiple,
    has_area,
    reject,
    to_ns,
)

_MOST_PERIODS = 1_000_000  # the robot remembers its motion of a whole turn of the LiDAR


@dataclass(frozen=True, slots=True, config=STRICT)
class RatesConfig:
    """Periods. Physics divides control. Control divides the periods of LiDAR and planner.

    Encoders and IMU are read once per control period.

    Attributes:
        physics_s: One step of MuJoCo, s.
        control_s: One period of the robot's software, s.
        lidar_s: One turn of the LiDAR, s.
        plan_s: One frame of the planner, s.
    """

    physics_s: Annotated[float, Field(ge=1e-6, le=0.01)] = 0.002
    control_s: Annotated[float, Field(ge=1e-6, le=0.1)] = 0.01
    lidar_s: Annotated[Period, Field(le=10.0)] = 0.1
    plan_s: Period = 1.83

    @model_validator(mode="after")
    def _periods_divide(self) -> RatesConfig:
        """Check for integer ratios in whole nanoseconds: no period may drift against another."""
        pairs = (("control_s", "physics_s"), ("lidar_s", "control_s"), ("plan_s", "control_s"))
        for slow, fast in pairs:
            long_s, short_s = getattr(self, slow), getattr(self, fast)
            check_multiple(f"rates.{slow}", long_s, f"rates.{fast}", short_s)
        if to_ns(self.lidar_s) > _MOST_PERIODS * to_ns(self.control_s):
            raise reject(
                f"rates.lidar_s = {self.lidar_s:g} s is more than {_MOST_PERIODS:,} times "
                f"rates.control_s = {self.control_s:g} s"
            )
        return self


Friction = Annotated[float, Field(gt=0.0, le=2.0)]


@dataclass(frozen=True, slots=True, config=STRICT)
class FrictionZone:
    """A rectangle of ground with its own friction.

    Attributes:
        min_m: Lower left corner (x, y) in map, m.
        max_m: Upper right corner (x, y) in map, m.
        friction: Coulomb coefficient.
    """

    min_m: Point
    max_m: Point
    friction: Friction

    @model_validator(mode="after")
    def _has_area(self) -> FrictionZone:
        if not has_area(self.min_m, self.max_m):
            raise reject("tracks.zones: min_m must be below max_m in x and in y")
        return self


@dataclass(frozen=True, slots=True, config=STRICT)
class FrictionImage:
    """A grey image of the ground's friction. Its upper edge is at the largest y.

    Each place has the friction of its nearest pixel. Grey values are interpolated between black
    and white.

    Attributes:
        file: PNG, relative to the scenario's file.
        min_m: Lower left corner (x, y) in map, m.
        max_m: Upper right corner (x, y) in map, m.
        black: Friction of a black pixel.
        white: Friction of a white pixel.
    """

    file: str
    min_m: Point
    max_m: Point
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

    Attributes:
        friction: Coulomb coefficient of the ground.
        zones: Rectangles with another friction. Where they overlap the last one holds. They cover
            ``friction_image``, which covers ``friction``.
        friction_image: An image of the friction.
        shear_modulus_m: Shear displacement at which the friction is reached, m.
        shear_damping_s: Damping of the shear, s.
        rolling_resistance: Rolling resistance over load.
    """

    friction: Friction = 0.6
    zones: tuple[FrictionZone, ...] = ()
    friction_image: FrictionImage | None = None
    shear_modulus_m: Annotated[float, Field(ge=1e-5, le=1.0)] = 0.001
    shear_damping_s: Small = 0.01
    rolling_resistance: Annotated[float, Field(ge=0.0, le=0.5)] = 0.02


@dataclass(frozen=True, slots=True, config=STRICT)
class MotorConfig:
    """EMG49 (24 V, 49:1) with an MD49 driver. All values are at the output shaft.

    Attributes:
        supply_v: Voltage of the supply, V.
        resistance_ohm: Resistance of the winding, ohm.
        torque_nm_per_a: Torque per current, N m/A.
        back_emf_v_per_radps: Voltage per speed, V s/rad.
        no_load_current_a: Current that overcomes the gears' friction, A.
        current_limit_a: Current limit of the driver, A per motor.
        brake_torque_nm: Torque of a holding brake on each sprocket, N m. It is not part of the
            EMG49: shorted motors and gear friction alone hold 0.5 N m each, a slope of 15 degrees.
        rotor_inertia_kgm2: Reflected inertia of the rotor, kg m^2.
    """

    supply_v: Annotated[float, Field(ge=0.1, le=1e3)] = 24.0
    resistance_ohm: Annotated[float, Field(ge=1e-4, le=1e9)] = 24.0 / 13.0
    torque_nm_per_a: Scale = 1.57 / 1.6
    back_emf_v_per_radps: Scale = (24.0 - 0.5 * 24.0 / 13.0) / 14.975
    no_load_current_a: NonNegative = 0.5
    current_limit_a: Scale = 5.0
    brake_torque_nm: NonNegative = 6.0
    rotor_inertia_kgm2: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.02


@dataclass(frozen=True, slots=True, config=STRICT)
class VehicleConfig:
    """The robot's body as its own software knows it (Sabiha 2022, Table 3).

    These values do not change the plant. Its true sizes are in the vehicle's model.

    Attributes:
        gauge_m: Distance between the tracks' centre lines, m.
        sprocket_radius_m: Radius of the sprockets, m.
        length_m: Length of the footprint, m.
        width_m: Width of the footprint, m.
        footprint_offsets_m: Centres of three discs that cover the footprint, along x, m.
        footprint_radius_m: Radius of these discs, m.
    """

    gauge_m: Length = 0.39
    sprocket_radius_m: Length = 0.037
    length_m: Length = 0.49
    width_m: Length = 0.465
    footprint_offsets_m: tuple[Offset, Offset, Offset] = (-0.16, 0.0, 0.16)
    footprint_radius_m: Length = 0.25


@dataclass(frozen=True, slots=True, config=STRICT)
class PayloadConfig:
    """A load on the chassis. The robot's software does not know it.

    Attributes:
        mass_kg: Its mass, kg.
        position_m: Its centre (x, y, z) in base_link, m.
    """

    mass_kg: Annotated[float, Field(ge=0.0, le=50.0)] = 0.0
    position_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.15)
