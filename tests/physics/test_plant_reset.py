"""A reset puts everything back: a run after it is the run of a plant that has done nothing yet."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from helpers.vehicles import vehicle_on_plane

from simloop.config import Config
from simloop.physics.plant import Plant


def model_with_a_mover():
    spec = vehicle_on_plane()
    mover = spec.worldbody.add_body(name="mover", pos=[3.0, 0.0, 0.5], mocap=True)
    mover.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.5])
    return spec.compile()


def run(plant, braked=False):
    """The digest of a short run from rest, with a bend in it."""
    plant.reset(np.array([0.3, -0.2, 0.7]), braked=braked)
    for k in range(60):
        plant.step(np.array([12.0, 12.0 - 0.1 * k]))
    return plant.state_hash()


def ice_on_the_left(plant):
    plant.ice((0.05, None))


def hand_that_pushes(plant):
    plant.push(np.array([40.0, 25.0]))


def mover_on_its_way(plant):
    plant.move(np.array([[3.2, 0.5]]))


def brakes_on(plant):
    plant.brake(True)


SPOILS = [ice_on_the_left, hand_that_pushes, mover_on_its_way, brakes_on]


@pytest.mark.parametrize("spoil", SPOILS)
def test_after_a_reset_the_run_is_that_of_a_new_plant(spoil):
    plant = Plant(model_with_a_mover(), Config())
    new = run(plant)
    spoil(plant)
    plant.step(np.array([20.0, -20.0]))
    assert plant.state_hash() != new
    assert run(plant) == new


def test_brakes_are_on_after_a_reset_only_if_asked_for():
    plant = Plant(model_with_a_mover(), Config())
    free, held = run(plant), run(plant, braked=True)
    assert free != held
    assert (run(plant), run(plant, braked=True)) == (free, held)


def test_plants_of_one_model_do_not_touch_each_others():
    """A step writes the joints' friction, which MuJoCo keeps in the model."""
    model = model_with_a_mover()
    before = model.dof_frictionloss.copy()
    other = Plant(model, Config())
    other.reset(np.zeros(3), braked=True)
    other.step(np.zeros(2))
    assert np.array_equal(model.dof_frictionloss, before)
    assert not np.array_equal(other.model.dof_frictionloss, before)
