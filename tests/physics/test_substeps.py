"""The compiled physics steps against those through MuJoCo's bindings, bit by bit."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import Config
from simloop.physics import engine
from simloop.physics.plant import Plant
from simloop.worlds.arena import build
from simloop.worlds.obstacles import Obstacle

WALL = Obstacle(shape="box", position_m=(0.7, 0.0), size_m=(0.1, 2.0))


def pair_of(*obstacles):
    model = build("open", list(obstacles))
    plants = [Plant(model, Config(), plain) for plain in (False, True)]
    for plant in plants:
        plant.reset(np.zeros(3))
    return plants


def same(fast, plain):
    a, b = (plant.truth(np.zeros(3)) for plant in (fast, plain))
    counts = [(t.contact_count, t.hit_count, t.in_contact) for t in (a, b)]
    return fast.state_hash() == plain.state_hash() and counts[0] == counts[1]


@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0)), min_size=5, max_size=40))
def test_compiled_steps_are_those_of_the_bindings(volts):
    fast, plain = pair_of(WALL)
    for pair in volts:
        for plant in (fast, plain):
            plant.step(np.array(pair))
        assert same(fast, plain)


def test_contacts_and_hits_are_counted_alike():
    fast, plain = pair_of(WALL)
    for volts in [np.full(2, 9.0)] * 300 + [np.zeros(2)] * 50:
        for plant in (fast, plain):
            plant.step(volts)
    assert same(fast, plain)
    assert fast.truth(np.zeros(3)).contact_count >= 1


def test_it_reads_the_contacts_that_the_bindings_show():
    fast, _ = pair_of(WALL)
    found = engine.find_engine(fast.model, fast.data)
    assert found is not None
    for k in range(200):
        fast.step(np.array([9.0, 8.0 + 0.01 * k]))
        mine, theirs = engine.contacts_of(found), engine.contact_arrays(fast.data)
        assert len(mine.row) == fast.data.ncon
        for a, b in zip(mine, theirs, strict=True):
            assert np.array_equal(a, b)
    mujoco.mj_resetData(fast.model, fast.data)
    assert len(engine.contacts_of(found).row) == 0


@pytest.fixture
def nothing_known():
    """The checks of the addresses are made anew, here and after the test."""
    cached = (engine._struct, engine._is_trusted)
    for one in cached:
        one.cache_clear()
    yield
    for one in cached:
        one.cache_clear()


@pytest.mark.parametrize("missing", ["mjData", "mjContact"])
def test_where_a_struct_is_not_described_the_bindings_step(monkeypatch, nothing_known, missing):
    kept = {name: struct for name, struct in engine.STRUCTS.items() if name != missing}
    monkeypatch.setattr(engine, "STRUCTS", kept)
    fast, plain = pair_of()
    assert engine.find_engine(fast.model, fast.data) is None
    fast.step(np.full(2, 6.0))
    plain.step(np.full(2, 6.0))
    assert same(fast, plain)


@pytest.mark.parametrize("field", ["contact", "efc_force"])
def test_an_address_that_is_not_that_of_the_bindings_is_refused(monkeypatch, nothing_known, field):
    """As with another MuJoCo than the one described: here two pointers have changed places."""
    fields = list(engine.STRUCTS["mjData"].fields)
    places = {one.name: k for k, one in enumerate(fields)}
    a, b = places[field], places["efc_aref"]
    fields[a], fields[b] = fields[b], fields[a]
    described = {**engine.STRUCTS, "mjData": replace(engine.STRUCTS["mjData"], fields=fields)}
    monkeypatch.setattr(engine, "STRUCTS", described)
    assert not engine._is_trusted()


def test_a_library_of_another_version_is_refused(monkeypatch, nothing_known):
    monkeypatch.setattr(engine.mujoco, "mj_version", lambda: 1)
    assert not engine._is_trusted()
