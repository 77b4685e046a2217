"""Who listens to a run: the recorder and the pictures, made from a scenario and its world."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simloop.recording.scene_shapes import scene_bodies, scene_shapes
from simloop.scenario.build import World
from simloop.scenario.scenario import Scenario

if TYPE_CHECKING:
    from simloop.recording.recorder import RerunRecorder
    from simloop.recording.snapshots import Snapshots


def title_of(scenario: Scenario) -> str:
    """What a recording or a sheet is called."""
    return f"{scenario.title or scenario.name}, seed {scenario.seed}"


def recorder_for(path: Path, scenario: Scenario, world: World) -> RerunRecorder:
    """A recorder of this run into a file; close it at the end. Raises OSError if it cannot open."""
    from simloop.recording.recorder import RerunRecorder

    return RerunRecorder(
        path,
        scene_shapes(world.model),
        scene_bodies(world.model),
        world.floor.bounds_m,
        scenario.goal,
        scenario.start,
        world.model.site("lidar").pos,
        scenario.config.vehicle,
        title_of(scenario),
        world.model.site("camera").pos if scenario.config.camera.enabled else None,
    )


def snapshots_for(directory: Path, scenario: Scenario, world: World) -> Snapshots:
    """The pictures of this run, drawn when it is finished."""
    from simloop.recording.snapshots import Snapshots

    vehicle = scenario.config.vehicle
    return Snapshots(world.model, directory, scenario.goal, vehicle, title_of(scenario))
