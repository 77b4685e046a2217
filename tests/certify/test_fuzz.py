"""Random vehicles, ground, drops and commands: nothing infinite, no warning, no free energy."""

from __future__ import annotations

import pytest

from simloop.certify.fuzz import Episode, episodes, run_episode


def failures(seed: int, steps: int) -> list[Episode]:
    done = list(episodes(seed, steps))
    assert sum(episode.steps for episode in done) >= steps
    return [episode for episode in done if episode.failure]


def test_thirty_thousand_random_steps():
    assert failures(0, 30_000) == []


def test_an_episode_is_made_from_its_seed_alone():
    assert run_episode(7) == run_episode(7)


@pytest.mark.slow
def test_a_million_random_steps():
    assert failures(100_000, 1_000_000) == []
