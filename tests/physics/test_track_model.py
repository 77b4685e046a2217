"""The simulated tracks against closed forms, on planes and slopes."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from helpers.track_forms import motion_of_icr
from helpers.vehicles import plant_on_plane

from simloop.config import (
    Config,
    FrictionZone,
    MotorConfig,
    PayloadConfig,
    RatesConfig,
    TracksConfig,
    VehicleConfig,
)
from simloop.physics import turning_theory
from simloop.physics.plant import Plant
from simloop.physics.track_contacts import patch_of
from simloop.physics.track_model import (
    friction_at,
    friction_map,
    motor_current,
    state_block,
    track_parameters,
)
from simloop.physics.vehicle_geoms import road_wheels
from simloop.worlds.arena import build

VEHICLE = VehicleConfig()
WEIGHT_N = 98.1


def drive(plant, volts, seconds):
    """The truth after ``seconds`` under constant voltages."""
    truth = None
    for _ in range(round(seconds / 0.01)):
        truth = plant.step(np.array(volts, float))
    return truth


def spin_ratio(truth):
    """chi: yaw rate over what the belts' speeds would give without slip."""
    left, right = truth.sprocket_radps
    belts = VEHICLE.sprocket_radius_m * (right - left)
    return truth.velocity_body[5] * VEHICLE.gauge_m / belts


@pytest.mark.parametrize(("friction", "volts"), [(0.4, 6.0), (0.6, 12.0), (0.9, 22.0)])
def test_spin_on_the_spot_has_the_closed_forms_ratio(friction, volts):
    plant = plant_on_plane(Config(tracks=TracksConfig(friction=friction)))
    truth = drive(plant, (-volts, volts), 3.0)
    assert spin_ratio(truth) == pytest.approx(
        turning_theory.spin_ratio(0.415, VEHICLE.gauge_m), rel=0.005
    )
    assert np.hypot(*truth.pose_xyyaw[:2]) < 0.002


@pytest.mark.parametrize("step_s", [0.001, 0.002, 0.005])
def test_spin_does_not_depend_on_the_step(step_s):
    plant = plant_on_plane(Config(rates=RatesConfig(physics_s=step_s)))
    truth = drive(plant, (-12.0, 12.0), 2.0)
    assert spin_ratio(truth) == pytest.approx(0.811, rel=0.01)


def test_straight_ahead_the_belt_carries_the_robot_without_slip():
    truth = drive(plant_on_plane(), (12.0, 12.0), 2.0)
    belt = truth.sprocket_radps * VEHICLE.sprocket_radius_m
    assert truth.velocity_body[0] == pytest.approx(belt.mean(), rel=1e-3)
    assert abs(truth.pose_xyyaw[1]) < 1e-3


def test_no_load_and_rated_speed_are_the_motors_own():
    p = track_parameters(TracksConfig(), MotorConfig(), VEHICLE.sprocket_radius_m, 0.002)
    assert motor_current(24.0, 143 * 2 * math.pi / 60, p) == pytest.approx(0.5, rel=0.01)
    assert motor_current(24.0, 0.0, p) == 5.0
    assert motor_current(-24.0, 0.0, p) == -5.0


def test_drawbar_is_limited_by_friction():
    """At full voltage against a wall of force the robot slips: thrust is mu W less the drag."""
    plant = plant_on_plane(Config(tracks=TracksConfig(friction=0.5)))
    plant.data.qfrc_applied[0] = 0.0
    for _ in range(200):
        plant.data.qvel[0] = 0.0  # held by an immovable rope
        truth = plant.step(np.array([24.0, 24.0]))
    pull = plant.tracks.track_force.sum()
    assert pull == pytest.approx(0.5 * WEIGHT_N, rel=0.02)
    assert truth.sprocket_radps.min() > 1.0


@pytest.mark.parametrize("friction", [0.4, 0.7])
def test_braked_on_a_slope_it_creeps_less_than_a_millimetre_a_second(friction):
    pitch = min(0.5 * math.atan(friction), 0.25)  # beyond, the unpowered gears give way
    plant = plant_on_plane(Config(tracks=TracksConfig(friction=friction)), pitch)
    before = drive(plant, (0.0, 0.0), 1.0).pose_xyyaw.copy()
    after = drive(plant, (0.0, 0.0), 2.0).pose_xyyaw
    assert np.hypot(*(after - before)[:2]) / 2.0 < 1e-3


def test_beyond_the_friction_angle_it_slides():
    plant = plant_on_plane(Config(tracks=TracksConfig(friction=0.3)), 1.3 * math.atan(0.3))
    assert drive(plant, (0.0, 0.0), 1.0).pose_xyyaw[0] < -0.1


def test_electrical_work_is_accounted_for():
    """Copper loss + gear friction + shear work + kinetic energy make up what the battery gave."""
    plant, motor = plant_on_plane(), MotorConfig()
    copper = friction = 0.0
    for k in range(300):
        volts = np.array([10.0 + 6 * math.sin(0.03 * k), 8.0 - 5 * math.sin(0.05 * k)])
        truth = plant.step(volts)
        current, speed = truth.motor_current_a, truth.sprocket_radps
        back_emf_gap = motor.back_emf_v_per_radps - motor.torque_nm_per_a
        copper += (current**2 * motor.resistance_ohm + back_emf_gap * current * speed).sum() * 0.01
        gear = plant.model.dof_frictionloss[plant.model.joint("sprocket_left_joint").dofadr[0]]
        friction += gear * np.abs(speed).sum() * 0.01
    kinetic = 0.5 * 10 * truth.velocity_body[0] ** 2
    kinetic += 0.5 * 0.28 * truth.velocity_body[5] ** 2 + 0.5 * 0.02 * (speed**2).sum()
    spent = copper + friction + plant.tracks.work[1] + kinetic
    assert spent == pytest.approx(truth.energy_j, rel=0.02)


def test_on_a_slope_the_load_moves_downhill_by_the_centre_of_masss_height():
    """Statics: the support's centre lies where gravity through the centre of mass meets it."""
    pitch = 0.2
    plant = plant_on_plane(pitch_rad=pitch)
    drive(plant, (0.0, 0.0), 1.0)
    model, data, load = plant.model, plant.data, plant.tracks.load
    wheels = [f"road_{side}_{i}" for side in ("left", "right") for i in range(6)]
    x = np.array([data.geom_xpos[model.geom(name).id][0] for name in wheels])
    com = data.subtree_com[model.body("base_link").id]
    assert load.sum() == pytest.approx(WEIGHT_N * math.cos(pitch), rel=1e-3)
    assert load @ x / load.sum() == pytest.approx(com[0] - com[2] * math.tan(pitch), abs=1e-3)


def test_at_an_even_speed_the_motors_pay_for_gears_and_rolling_alone():
    tracks, motor = TracksConfig(rolling_resistance=0.05), MotorConfig()
    truth = drive(plant_on_plane(Config(tracks=tracks)), (12.0, 12.0), 3.0)
    rolling = 0.05 * WEIGHT_N * VEHICLE.sprocket_radius_m
    gears = 2 * motor.no_load_current_a * motor.torque_nm_per_a
    torque = truth.motor_current_a.sum() * motor.torque_nm_per_a
    assert torque == pytest.approx(gears + rolling, rel=0.02)


def test_a_wheel_in_the_air_forgets_its_shear():
    plant = plant_on_plane()
    drive(plant, (12.0, 12.0), 0.1)
    assert np.abs(plant.tracks.mean).max() > 1e-5
    plant.data.qpos[2] += 0.2
    drive(plant, (0.0, 0.0), 0.01)
    assert not plant.tracks.mean.any() and not plant.tracks.load.any()


def test_the_tracks_truth_is_the_motions_own():
    """ICRs give the motion back; loads carry the weight; shear takes what slip costs."""
    plant = plant_on_plane()
    truth = drive(plant, (6.0, 14.0), 2.0)
    tracks = plant.track_truth()
    belts = VEHICLE.sprocket_radius_m * truth.sprocket_radps
    motion = motion_of_icr(turning_theory.Icr(*tracks.icr_m), tuple(belts))
    assert motion == pytest.approx(truth.velocity_body[[0, 1, 5]], rel=1e-6)
    assert tracks.wheel_load_n.sum() == pytest.approx(WEIGHT_N, rel=0.01)
    assert tracks.slip_mps[0] > 0 > tracks.slip_mps[1]  # the inner track brakes
    over_ground = truth.velocity_body[0] - truth.velocity_body[5] * np.array([0.195, -0.195])
    assert tracks.slip_mps == pytest.approx(over_ground - belts, abs=1e-5)
    assert tracks.shear_work_j > 0.1
    assert np.isnan(plant_on_plane().track_truth().icr_m).all()


def test_zones_have_a_friction_of_their_own_and_the_last_one_holds():
    zones = friction_map([FrictionZone((0, 0), (2, 2), 0.3), FrictionZone((1, 1), (2, 2), 0.9)])
    places = [(0.5, 0.5), (1.5, 1.5), (3.0, 0.5), (-0.1, 0.5)]
    assert [friction_at(*at, zones, 0.6) for at in places] == [0.3, 0.9, 0.6, 0.6]
    with pytest.raises(ValueError, match="min_m"):
        FrictionZone((1, 0), (0, 1), 0.5)


def test_a_vehicle_must_have_the_same_wheels_on_both_sides():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom name='road_left_0' size='1'/></worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match="same number of road wheels"):
        road_wheels(model)


def test_a_payload_in_the_scenario_is_carried():
    config = PayloadConfig(4.0, (0.1, 0.0, 0.15))
    plant = Plant(build("open", payload=config), Config())
    plant.reset(np.zeros(3))
    load = plant.track_truth().wheel_load_n
    assert load.sum() == pytest.approx(WEIGHT_N + 4 * 9.81, rel=1e-3)
    assert load[0] > load[5] * 1.3


def test_a_patch_is_known_again_by_its_normal_and_by_what_it_lies_on():
    state = state_block(12)[0]
    touched = state["touched"][:12]
    touched[:] = 0.0
    first = patch_of(state, touched, 3, 0, 0.0, 0.0, 1.0)
    state["mean"][3, first] = 5e-4  # strained
    touched[3, first, 0] = 10.0
    assert patch_of(state, touched, 3, 0, 0.05, 0.0, 0.998) == first
    on_a_sled = patch_of(state, touched, 3, 7, 0.0, 0.0, 1.0)
    assert on_a_sled != first and not state["mean"][3, on_a_sled].any()
    assert patch_of(state, touched, 3, 0, 1.0, 0.0, 0.0) != first  # a step's edge
