"""The plant's sprockets are the model's; the configuration's are what the robot believes."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.vehicles import vehicle_on_plane

from simloop.config import Config, VehicleConfig
from simloop.physics.plant import Plant


def driven(model, config):
    """A plant and its truth after two seconds straight ahead."""
    plant = Plant(model, config)
    truth = plant.reset(np.zeros(3))
    for _ in range(200):
        truth = plant.step(np.array([8.0, 8.0]))
    return plant, truth


def test_what_the_robot_believes_does_not_change_the_plant():
    model = vehicle_on_plane().compile()
    plants = [
        driven(model, Config(vehicle=VehicleConfig(sprocket_radius_m=radius, gauge_m=gauge)))[0]
        for radius, gauge in ((0.037, 0.39), (0.045, 0.3))
    ]
    assert plants[0].state_hash() == plants[1].state_hash()


def test_it_is_the_models_radius_to_the_bit():
    plant, truth = driven(vehicle_on_plane().compile(), Config())
    assert plant.sprocket_radius_m == 0.037
    assert truth.velocity_body[0] == pytest.approx(0.037 * truth.sprocket_radps.mean(), rel=2e-3)


def test_a_model_with_other_sprockets_drives_by_them():
    spec = vehicle_on_plane()
    for side in ("left", "right"):
        spec.site(f"sprocket_{side}_rim").size = [0.05, 0.0375, 0.0]
    plant, truth = driven(spec.compile(), Config())
    assert plant.sprocket_radius_m == 0.05
    assert truth.velocity_body[0] == pytest.approx(0.05 * truth.sprocket_radps.mean(), rel=2e-3)


def test_both_sprockets_must_be_alike_and_there():
    spec = vehicle_on_plane()
    spec.site("sprocket_left_rim").size = [0.05, 0.0375, 0.0]
    with pytest.raises(ValueError, match=r"sprocket_left_rim.*0\.05.*sprocket_right_rim.*0\.037"):
        Plant(spec.compile(), Config())
    spec = vehicle_on_plane()
    spec.delete(spec.site("sprocket_right_rim"))
    with pytest.raises(ValueError, match="no site 'sprocket_right_rim'"):
        Plant(spec.compile(), Config())
