"""The page that shows how to add a planner: its code is run as it stands."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.standard_functions import StandardFunction

from simloop.benchmarks.planners.scenes import scene
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.metaheuristics.population import Population, minimise
from simloop.planners.metaheuristics.population_planner import PopulationPlanner
from simloop.planners.protocol import PlanningTask
from simloop.planners.splitmix import make_state

PAGE = Path(__file__).parents[2] / "docs" / "add_a_planner.md"
POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def code():
    found = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(found) == 1
    return found[0]


@pytest.fixture(scope="module")
def jaya(code, tmp_path_factory):
    file = tmp_path_factory.mktemp("newcomer") / "rule_jaya.py"
    file.write_text(code)
    spec = importlib.util.spec_from_file_location("rule_jaya", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules["rule_jaya"] = module
    spec.loader.exec_module(module)
    return module.Jaya


def test_the_newcomer_is_short_and_clean(code, tmp_path):
    assert len(code.splitlines()) < 60
    file = tmp_path / "rule_jaya.py"
    file.write_text(code)
    config = PAGE.parents[1] / "pyproject.toml"
    subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--config", str(config), str(file)], check=True
    )


def test_the_newcomer_minimises(jaya):
    population = Population(
        StandardFunction("sphere", 5), 20, 4000, make_state(np.random.default_rng(0))
    )
    minimise(jaya(), population)
    assert population.spent == 4000 and population.best_cost < 1e-3


def test_the_newcomer_plans(jaya):
    one = scene("S1")[0]
    config = PlannerConfig(safe_distance_m=one.safe_m, start_turn_weight=0.0)
    planner = PopulationPlanner(jaya, config, POINT)
    found = planner.plan(
        PlanningTask(one.world, one.start, one.goal, one.safe_m), np.random.default_rng(1000)
    )
    assert found.safe and found.planner == "jaya"
    assert 4.42 < found.cost < 1.02 * 4.4250 and found.evaluations <= 40_000


_COMPILED = """
import sys
import numpy as np
from numba.core import event
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner
from simloop.benchmarks.planners.scenes import scene

class Heard(event.Listener):
    names = []
    def on_start(self, event):
        self.names.append(event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

with event.install_listener("numba:compile", Heard()):
    one, field = scene("S1")[0], scene("S4a")[0]
    for name in sys.argv[1:]:
        config = PlannerConfig(name=name, max_evaluations=1000)
        for where in (one, field):
            rng = np.random.default_rng(0)
            task = PlanningTask(where.world, where.start, where.goal, config.safe_distance_m)
            make_planner(config, VehicleConfig()).plan(task, rng)
print(" ".join(Heard.names))
"""
_ALL = [
    *("tlbo", "tlbo_paper", "tlbo_elitist", "niwtlbo", "ga", "pso", "ga_pso", "abc", "de", "avoa"),
    *("apso", "wdo", "potential_field", "ga_apf", "avoa_online", "apso_online", "fuzzy_wdo"),
]


def test_nothing_is_compiled_in_a_second_process():
    """Kernels come from the cache, whichever planner is asked for, once they were compiled."""

    def compiled():
        ran = subprocess.run(
            [sys.executable, "-c", _COMPILED, *_ALL], capture_output=True, text=True, check=True
        )
        return ran.stdout.split()

    compiled()
    assert compiled() == []
