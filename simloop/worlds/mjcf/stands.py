"""Decide what each geom of an arena is, from its shape and place, and set its contacts by that.

A geom that stands is seen by the LiDAR, touched by the vehicle and on the floor plan, all three or
none. So the contact bits that an arena's file has cannot hide a wall from the referee.
"""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np

from simloop.common.errors import InputError, printable
from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import SEEN_GROUPS
from simloop.worlds.mjcf.climb import Climb, climbed
from simloop.worlds.mjcf.concave import is_concave
from simloop.worlds.mjcf.reader import listed
from simloop.worlds.solids import solid_of_model

FLOOR_BITS, OBSTACLE_BITS, LOOSE_BITS = (2, 0), (1, 0), (1, 3)
"""contype and conaffinity. The hull has conaffinity 1 and the wheels 3: both touch obstacles, and
the hull never touches the floor."""
GROUND_BITS = (3, 0)
BELLY_M = 0.02
"""Height of the hull's lower edge. Lower ground touches only the wheels."""
_NAMED_FLAT_M, _FLAT_M = 0.01, 0.001
_LEVEL = 1.0 - 1e-6
_FINEST_CELL_M = 0.005
_GROUND = "ground_"
_STANDING_NAMES = ("wall", "obstacle", _GROUND, "loose_")
_VEHICLE = 3  # conaffinity of the wheels; that of the hull is 1, and both have contype 0
_UNSEEN = 2  # the geom group of decoration
_PLANE, _BOX = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_BOX
_HFIELD = mujoco.mjtGeom.mjGEOM_HFIELD
_NO_SOLID = (_PLANE, mujoco.mjtGeom.mjGEOM_SDF)


class Stands:
    """Places and shapes of an arena's geoms, from its compiled model."""

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel, climb: Climb) -> None:
        """Compute the places.

        Args:
            spec: the arena.
            model: the same, compiled by itself.
            climb: what the vehicle climbs; ``ground_*`` that is higher stands.
        """
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._model, self._data = model, data
        self._geoms: list[mujoco.MjsGeom] = sorted(spec.geoms, key=lambda geom: int(geom.id))
        self._static = model.body_weldid[model.geom_bodyid] == 0
        self._up = data.geom_xmat[:, 8]
        self._noted: dict[str, list[str]] = {}
        self._climb = climb
        self._ground = self._climbed()

    def _climbed(self) -> set[int]:
        """List the geoms that are ground: by their names, if the vehicle can get onto them."""
        named = [
            number
            for number, geom in enumerate(self._geoms)
            if self._static[number] and geom.name.startswith(_GROUND) and geom.type not in _NO_SOLID
        ]
        solids = [
            None
            if self._model.geom_type[number] == int(_HFIELD)
            else solid_of_model(self._model, self._data, number)
            for number in named
        ]
        return {
            n for n, yes in zip(named, climbed(solids, self._climb, BELLY_M), strict=True) if yes
        }

    def classify(self, path: Path, said: list[str]) -> FloatArray | None:
        """Name the floor, and set the contacts of all geoms.

        Args:
            path: the arena's file, for messages.
            said: what the user must know; extended.

        Returns:
            (4,) the rectangle of the floor in map, m; None if it has no end.

        Raises:
            InputError: the arena has no floor, or a plane or a group that cannot be used.
        """
        floors = self._floors(path)
        floor = next((g for g in floors if g.name == "floor"), floors[0])
        if floor.name != "floor":
            said.append(f"the floor is the geom {printable(floor.name, 40) or '(no name)'}")
        numbers = {int(geom.id) for geom in floors}
        for number, geom in enumerate(self._geoms):
            self._settle(number, geom, number in numbers)
        said += [f"{text}: {listed(names)}" for text, names in self._noted.items()]
        self._rename(floor, floors)
        return self._rectangle(floor)

    def _settle(self, number: int, geom: mujoco.MjsGeom, is_floor: bool) -> None:
        """Set the contacts and the group of one geom by what it is."""
        before = (geom.contype, geom.conaffinity)
        self._take_contact_rules(number, geom)
        if geom.type == _PLANE and not is_floor:
            self._check_plane(number, geom)
            geom.contype = geom.conaffinity = 0
            return
        if not is_floor and before == (0, 0) and not geom.name.startswith(_STANDING_NAMES):
            if geom.group in SEEN_GROUPS:
                geom.group = _UNSEEN
                self._note("decoration, neither seen nor touched (contype and conaffinity 0)", geom)
            return
        if is_floor and geom.group not in SEEN_GROUPS:
            geom.group = SEEN_GROUPS[0]
        if geom.group not in SEEN_GROUPS:
            raise InputError(
                f"geom {_name(geom)} is in group {geom.group}, which the LiDAR does not see: use 0"
            )
        geom.contype, geom.conaffinity = FLOOR_BITS if is_floor else self._bits(number, geom)
        if not before[0] & _VEHICLE:
            self._note("touched, whatever contype and conaffinity say", geom)
        if is_concave(self._model, number):
            self._note("concave: the robot touches the convex hull, its LiDAR sees the mesh", geom)

    def _note(self, text: str, geom: mujoco.MjsGeom) -> None:
        self._noted.setdefault(text, []).append(geom.name)

    def _floors(self, path: Path) -> list[mujoco.MjsGeom]:
        """List the level planes and boxes whose upper face is the floor, planes first."""
        found: list[tuple[bool, float, mujoco.MjsGeom]] = []
        odd = []
        for number, geom in enumerate(self._geoms):
            kind = mujoco.mjtGeom(int(self._model.geom_type[number]))
            size = self._model.geom_size[number]
            if not self._static[number] or kind not in (_PLANE, _BOX):
                continue
            named = geom.name == "floor"
            top = self._data.geom_xpos[number, 2] + (size[2] if kind == _BOX else 0.0)
            level = abs(self._up[number]) > _LEVEL if kind == _BOX else self._up[number] > _LEVEL
            if level and abs(top) <= (_NAMED_FLAT_M if named else _FLAT_M):
                endless = kind == _PLANE and not np.all(size[:2] > 0.0)
                area = np.inf if endless else float(size[0] * size[1])
                found.append((kind != _PLANE, -area, geom))
            elif named or (level and kind == _PLANE):
                name = printable(geom.name, 40) or "(no name)"
                at = f"its upper face is at z = {top:g} m" if level else "it is not level"
                odd.append(f"{name}: {at}")
        if not found or any(one.startswith("floor: ") for one in odd):
            hint = f" ({'; '.join(odd[:3])})" if odd else ""
            raise InputError(
                f"{path.name}: the arena has no floor: a plane at z = 0, or a box whose upper "
                f"face is there{hint}"
            )
        return [geom for *_, geom in sorted(found, key=lambda one: one[:2])]

    def _bits(self, number: int, geom: mujoco.MjsGeom) -> tuple[int, int]:
        """Choose contype and conaffinity of a geom that is no floor, from what it is."""
        name = _name(geom)
        if geom.type == mujoco.mjtGeom.mjGEOM_SDF:
            raise InputError(
                f"geom {name} is of type sdf, whose outline cannot be told: use a mesh"
            )
        if number in self._ground:
            self._check_field(number, geom)
            return GROUND_BITS if self._top(number) > BELLY_M else FLOOR_BITS
        if geom.type == _HFIELD:
            raise InputError(
                f"geom {name} is a height field, which can only be ground: name it ground_*"
            )
        if not self._static[number]:
            return LOOSE_BITS
        if geom.name.startswith(_GROUND):
            self._note("too high or too steep for the robot to climb, so an obstacle", geom)
            geom.name = self._free_name(f"obstacle_{geom.name}")
        return OBSTACLE_BITS

    def _check_field(self, number: int, geom: mujoco.MjsGeom) -> None:
        """Raise InputError for a height field so fine that contacts with it take very long.

        Steep places in it are named: they are like walls, and are not on the floor plan.
        """
        if int(self._model.geom_type[number]) != int(_HFIELD):
            return
        field = self._model.geom_dataid[number]
        points = np.array([self._model.hfield_ncol[field], self._model.hfield_nrow[field]])
        cell = 2.0 * self._model.hfield_size[field, :2] / np.maximum(points - 1, 1)
        if cell.min() < _FINEST_CELL_M:
            raise InputError(
                f"geom {_name(geom)} is a height field with cells of {cell.min():.2g} m: the "
                f"least is {_FINEST_CELL_M:g} m"
            )
        first = self._model.hfield_adr[field]
        heights = self._model.hfield_data[first : first + points.prod()].reshape(points[::-1])
        for axis, length in enumerate(cell[::-1]):
            rise = self._model.hfield_size[field, 2] * np.abs(np.diff(heights, axis=axis)).max()
            slope = math.atan2(rise, length)
            if rise > self._climb.height_m and slope > self._climb.angle_rad:
                self._note("ground too steep to climb in places; touching it is no contact", geom)
                return

    def _top(self, number: int) -> float:
        """Compute an upper limit of a geom's height, m."""
        if int(self._model.geom_type[number]) == int(_HFIELD):
            size = self._model.hfield_size[self._model.geom_dataid[number]]
            return float(self._data.geom_xpos[number, 2] + size[2])
        box = self._model.geom_aabb[number]
        reach = np.abs(self._data.geom_xmat[number, 6:9]) @ box[3:]
        middle = self._data.geom_xmat[number, 6:9] @ box[:3]
        return float(self._data.geom_xpos[number, 2] + middle + reach)

    def _check_plane(self, number: int, geom: mujoco.MjsGeom) -> None:
        """Raise InputError for a plane that would stand: MuJoCo's planes have no end."""
        below = self._up[number] > _LEVEL and self._data.geom_xpos[number, 2] < 0.0
        if self._static[number] and (below or not (geom.contype or geom.conaffinity)):
            return
        name = _name(geom)
        raise InputError(
            f"geom {name} is a plane that is not the floor: MuJoCo's planes have no end, use a box"
        )

    def _take_contact_rules(self, number: int, geom: mujoco.MjsGeom) -> None:
        """Take away what would change how the vehicle is touched."""
        for key in ("margin", "gap", "adhesion", "surfacevel"):
            value = np.asarray(getattr(geom, key))
            if np.any(value != 0.0):
                self._note(f"{key} not used, because the vehicle's own is", geom)
                setattr(geom, key, np.zeros_like(value) if value.ndim else 0.0)
        most = 0 if self._static[number] else 1
        if geom.priority > most:
            self._note("priority not used, because the vehicle's own is", geom)
            geom.priority = most

    def _rename(self, floor: mujoco.MjsGeom, floors: list[mujoco.MjsGeom]) -> None:
        """Give the floor its name, and other faces at its height names of ground."""
        for number, geom in enumerate(floors):
            if geom != floor and not geom.name.startswith(_GROUND):
                geom.name = self._free_name(f"{_GROUND}{geom.name or number}")
        floor.name = "floor"

    def _free_name(self, name: str) -> str:
        """Lengthen a name until no geom has it."""
        taken = {geom.name for geom in self._geoms}
        while name in taken:
            name += "_"
        return name

    def _rectangle(self, floor: mujoco.MjsGeom) -> FloatArray | None:
        """Compute the floor's least and greatest x and y (4,), m; None without an end."""
        number = int(floor.id)
        half = self._model.geom_size[number, :2]
        if not np.all(half > 0.0):
            return None
        turn = np.abs(self._data.geom_xmat[number].reshape(3, 3)[:2, :2])
        reach, middle = turn @ half, self._data.geom_xpos[number, :2]
        return np.concatenate([middle - reach, middle + reach])


def _name(geom: mujoco.MjsGeom) -> str:
    return printable(geom.name, 80) or "without a name"
