"""Random vehicles, ground, drops and commands: no state may become infinite or gain energy.

An episode depends only on its seed, so one number is enough to reproduce a failure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from simloop.certify.ground import kinetic_and_potential, spent_j
from simloop.certify.rig import CONTROL_S, Bench, Rig
from simloop.certify.rig_parts import Block
from simloop.worlds.terrain import MOST_ROUGH_STEP_S

_STEPS_S = (0.001, 0.002, 0.005)
_EPISODE_S = 4.0
_FASTEST_MPS = 50.0  # four seconds of free fall give 39 m/s
_LEAST_J, _SHARE = 0.5, 0.01  # tolerated energy gain: a constant, and a share of the turnover
_CLEAR_M = 0.65  # least distance between the centres of things that must not overlap at the start


@dataclass(frozen=True, slots=True)
class Episode:
    """The outcome of one episode.

    Attributes:
        seed: seed of the episode.
        steps: number of physics steps.
        gain_j: largest energy gain without a source.
        turnover_j: total energy that was converted.
        failure: what failed; empty if nothing failed.
    """

    seed: int
    steps: int
    gain_j: float
    turnover_j: float
    failure: str


def episodes(seed: int, least_steps: int) -> Iterator[Episode]:
    """Run episodes with consecutive seeds.

    Args:
        seed: the first seed.
        least_steps: no further episode begins after this many physics steps.

    Yields:
        Each episode when it is done.
    """
    done = 0
    while done < least_steps:
        episode = run_episode(seed)
        yield episode
        done, seed = done + episode.steps, seed + 1


def random_rig(rng: np.random.Generator) -> Rig:
    """Draw a vehicle and its ground.

    Args:
        rng: the episode's generator.

    Returns:
        The rig.
    """
    step, friction = float(rng.choice(_STEPS_S)), float(rng.uniform(0.1, 1.2))
    blocks = []
    for _ in range(int(rng.integers(0, 6))):
        x, y = rng.uniform(-1.0, 1.0, 2)
        high = float(rng.choice([0.005, 0.015, 0.05, 0.3]))
        kind = "ground_block" if high < 0.1 else "wall"
        half = (float(rng.uniform(0.02, 0.4)), float(rng.uniform(0.02, 0.4)), 0.25)
        tilted = kind != "wall" and rng.random() < 0.3
        tilt = float(rng.uniform(-0.3, 0.3)) if tilted else 0.0
        blocks.append(Block((x, y, high - 0.25), half, tilt, name=kind))
    for _ in range(int(rng.integers(0, 3))):
        # Clear of the vehicle and of one another. Things that overlap at the start are pushed
        # apart, and this gives them energy.
        x, y = rng.uniform(-1.0, 1.0, 2)
        if math.hypot(x, y) < _CLEAR_M or any(
            block.mass_kg and math.dist((x, y), block.centre_m[:2]) < _CLEAR_M for block in blocks
        ):
            continue
        a, b, c = (float(h) for h in rng.uniform(0.03, 0.12, 3))
        blocks.append(Block((x, y, c + 0.35), (a, b, c), 0.0, float(rng.uniform(0.2, 5.0))))
    rough = 0.0
    if step <= MOST_ROUGH_STEP_S and rng.random() < 0.5:
        rough = float(rng.uniform(0.005, 0.06))
    return Rig(
        wheels=int(rng.integers(4, 11)),
        payload_kg=float(rng.uniform(0.1, 8.0)) if rng.random() < 0.5 else 0.0,
        payload_m=(
            float(rng.uniform(-0.15, 0.15)),
            float(rng.uniform(-0.12, 0.12)),
            float(rng.uniform(0.05, 0.3)),
        ),
        friction=friction,
        step_s=step,
        pitch_rad=float(rng.uniform(-0.3, 0.3)),
        roll_rad=float(rng.uniform(-0.3, 0.3)),
        blocks=tuple(blocks),
        rough_m=rough,
        rough_seed=int(rng.integers(1 << 31)),
    )


def _drop(bench: Bench, rng: np.random.Generator) -> None:
    """Place the vehicle near the middle, tilted, at any heading, 0.2 to 0.5 m above all blocks."""
    data, model = bench.plant.data, bench.plant.model
    yaw, roll, pitch = rng.uniform(-math.pi, math.pi), *rng.uniform(-0.4, 0.4, 2)
    data.qpos[:2] = rng.uniform(-0.1, 0.1, 2)
    tops = [block.centre_m[2] + block.half_m[2] for block in bench.rig.blocks if not block.mass_kg]
    data.qpos[2] = max(0.05, *tops, 0.05) + rng.uniform(0.2, 0.5)
    mujoco.mju_euler2Quat(data.qpos[3:7], np.array([yaw, pitch, roll]), "ZYX")
    data.qvel[:] = 0.0
    data.qvel[:6] = rng.uniform(-0.5, 0.5, 6)
    mujoco.mj_forward(model, data)


def run_episode(seed: int) -> Episode:
    """Drop a random vehicle on random ground, and drive it randomly for four seconds.

    Args:
        seed: seed of the whole episode.

    Returns:
        The episode.
    """
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    bench = rig.build(settle_s=0.0)
    _drop(bench, rng)
    bench.drive((0.0, 0.0), CONTROL_S)
    start = kinetic_and_potential(bench) + spent_j(bench)
    most, turnover, failure, ticks = 0.0, 0.0, "", 0
    left = right = 0.0
    while ticks * CONTROL_S < _EPISODE_S and not failure:
        if ticks % 20 == 0:
            left, right = rng.uniform(-24.0, 24.0, 2)
            bench.plant.brake(bool(rng.random() < 0.15))
        bench.drive((left, right), CONTROL_S)
        ticks += 1
        failure = _failure(bench)
        gain = kinetic_and_potential(bench) + spent_j(bench) - start
        most = max(most, gain)
        work = bench.plant.work_j()
        turnover = abs(start) + float(work[1] + work[2] + abs(work[3]))
        if not failure and gain > _LEAST_J + _SHARE * turnover:
            failure = f"{gain:.3f} J from nowhere after {ticks * CONTROL_S:.2f} s"
    return Episode(seed, ticks * bench.plant.substeps, most, turnover, failure)


def _failure(bench: Bench) -> str:
    """Describe what is wrong with the present state; empty if nothing is."""
    data = bench.plant.data
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        return "the state is not finite"
    for kind, warning in enumerate(data.warning):
        if warning.number:
            return f"MuJoCo: {mujoco.mjtWarning(kind).name}"
    if np.abs(data.qvel[:3]).max() > _FASTEST_MPS:
        return f"the vehicle moves at {np.abs(data.qvel[:3]).max():.1f} m/s"
    return ""
