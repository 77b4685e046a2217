"""All changes around the robot: moving obstacles, the goal, and faults of the plant."""

from __future__ import annotations

import numpy as np

from simloop.messages import FloatArray, GoalReading
from simloop.physics.faults import Faults
from simloop.physics.plant import Plant
from simloop.scenario.build import World
from simloop.scenario.scenario import Scenario
from simloop.simulation.random_streams import RandomStreams
from simloop.truth import Truth
from simloop.worlds.movers.crowd import Crowd, MovingGoal


class Goal:
    """The true goal, static or moving, and the readings of it that the robot gets.

    Attributes:
        position_m: (2,) true position in map, m.
    """

    def __init__(self, scenario: Scenario, world: World, rng: np.random.Generator) -> None:
        self.position_m: FloatArray = np.array(scenario.goal)
        self._motion: MovingGoal | None = None
        if scenario.goal_motion is not None:
            config = scenario.config
            self._motion = MovingGoal(
                scenario.goal_motion,
                scenario.goal,
                world.floor,
                world.body,
                config.rates.control_s,
                rng,
            )

    @property
    def moves(self) -> bool:
        """Whether the goal moves during the run."""
        return self._motion is not None

    def step(self) -> None:
        """Move the goal by one control period."""
        if self._motion is not None:
            self.position_m = self._motion.step()

    def read(self, t_ns: int) -> GoalReading | None:
        """Make the robot's reading of a moving goal.

        Args:
            t_ns: Simulated time, ns.

        Returns:
            The noisy reading, or None if the goal is static or no reading is due.
        """
        return None if self._motion is None else self._motion.reading(t_ns, self.position_m)


class Environment:
    """Acts on the plant before each of its steps: first the faults, then the moving things.

    Attributes:
        goal: The true goal.
    """

    def __init__(
        self, scenario: Scenario, world: World, faults: Faults, random: RandomStreams
    ) -> None:
        config = scenario.config
        self.goal = Goal(scenario, world, random.goal)
        self._faults = faults
        self._crowd: Crowd | None = None
        if world.movers:
            self._crowd = Crowd(
                world.movers, world.floor, world.body, config.rates.control_s, random.movers
            )

    def step(self, plant: Plant, truth: Truth) -> None:
        """Apply all changes around the robot in the coming control period.

        Args:
            plant: The plant, changed in place.
            truth: Ground truth at the start of the period.
        """
        self._faults.act(plant, truth)
        if self._crowd is not None:
            plant.move(self._crowd.step(truth.pose_xyyaw, truth.in_contact))
        self.goal.step()
