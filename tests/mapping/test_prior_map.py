"""A robot that is given a map: localising in it, extending it, and errors in the file."""

from __future__ import annotations

import pytest

from simloop.common.errors import InputError
from simloop.config import SlamConfig
from simloop.loop import Simulation
from simloop.mapping.grid_map import GridMap
from simloop.mapping.map_files import save_map
from simloop.messages import MapUpdate
from simloop.scenario.load import load


def run(*overrides):
    heard = []
    simulation = Simulation(load("experiment", overrides), listeners=[heard.append])
    return simulation, simulation.run(), [m for m in heard if isinstance(m, MapUpdate)]


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    _, result, maps = run()
    file = tmp_path_factory.mktemp("maps") / "room.yaml"
    save_map(GridMap.of(SlamConfig(), maps[-1].origin_m, maps[-1].log_odds), file)
    return file, result


def test_with_a_map_the_first_plan_knows_the_room_and_the_robot_only_localises(known):
    file, without = known
    _, result, maps = run(f'slam.prior_map="{file}"', "slam.extend_map=false")
    assert result.outcome == "reached" and result.metrics["ate_rmse_m"] < 0.05
    assert result.metrics["replans"] <= without.metrics["replans"]
    occupied = [(m.log_odds > 0.5).sum() for m in maps]
    assert occupied[0] == occupied[-1] > 100


def test_a_given_map_may_be_extended(known):
    _, result, maps = run(f'slam.prior_map="{known[0]}"')
    assert result.outcome == "reached"
    assert (maps[0].log_odds != maps[-1].log_odds[: maps[0].log_odds.shape[0]]).any()


def test_a_wrong_map_is_one_line(tmp_path):
    for name in ("none.yaml", "rubbish.yaml"):
        (tmp_path / "rubbish.yaml").write_text("image: x.pgm\n")
        with pytest.raises(InputError, match=name):
            load("experiment", [f'slam.prior_map="{tmp_path / name}"'])
    with pytest.raises(InputError, match="extend_map"):
        load("experiment", ["slam.extend_map=false"])
