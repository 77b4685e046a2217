"""Draw what the robot believes as a flat picture: map, scan, discs, paths and footprint.

Images are (height, width, 3) uint8 in OpenCV's colour order, blue first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simloop.config import VehicleConfig
from simloop.messages import FloatArray, LidarScan, MapUpdate, Plan, SmoothPath, WorldView

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

INK: Colour = (52, 44, 40)
PAPER: Colour = (255, 255, 255)
UNKNOWN: Colour = (219, 214, 209)
PATH: Colour = (201, 106, 30)
PLAN: Colour = (168, 60, 160)
CANDIDATE: Colour = (222, 196, 170)
DISC: Colour = (40, 130, 235)
MOVER: Colour = (30, 30, 150)
SCAN: Colour = (48, 48, 214)
TRAIL: Colour = (110, 150, 60)
GOAL: Colour = (70, 160, 40)

_SHIFT = 4
"""OpenCV draws at 1/16 of a pixel."""
_SURE_LOG_ODDS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """What the robot believes at one instant. A part that it does not have yet is None.

    Attributes:
        pose: (3,) x, y, yaw of base_link in map.
        goal: (2,) goal in map, m.
        trail_m: (N, 2) believed positions so far in map, m.
        grid: The robot's map.
        world: The planner's world.
        plan: The last plan.
        path: The path that the robot follows.
        scan: The last scan.
        scan_pose: (3,) x, y, yaw of base_link in map when ``scan`` was taken.
    """

    pose: FloatArray
    goal: FloatArray
    trail_m: FloatArray
    grid: MapUpdate | None = None
    world: WorldView | None = None
    plan: Plan | None = None
    path: SmoothPath | None = None
    scan: LidarScan | None = None
    scan_pose: FloatArray | None = None


class PlannerView:
    """Draws beliefs over a fixed part of the map."""

    def __init__(
        self,
        bounds_m: Sequence[float] | FloatArray,
        size_px: int,
        vehicle: VehicleConfig,
        laser_m: Sequence[float] | FloatArray = (0.0, 0.0),
    ) -> None:
        """Choose the part of the map and the size of the image.

        Args:
            bounds_m: (4,) x_min, y_min, x_max, y_max in map that the image must show, m.
            size_px: Width and height of the image, px.
            vehicle: Size of the vehicle.
            laser_m: (2,) position of the LiDAR in base_link, m.
        """
        low, high = np.array(bounds_m[:2], float), np.array(bounds_m[2:], float)
        self._size_px = size_px
        self._scale = size_px / (float(np.max(high - low)) + 0.3)
        self._centre_m = 0.5 * (low + high)
        self._vehicle = vehicle
        self._laser_m = np.array(laser_m, float)

    def draw(self, belief: Belief) -> Image:
        """Draw one belief.

        Args:
            belief: What the robot believes.

        Returns:
            (size_px, size_px, 3) image, x to the right and y up.
        """
        image = self._ground(belief.grid)
        if belief.world is not None:
            for x, y, radius in belief.world.discs_xyr_m:
                self._circle(image, (x, y), radius, DISC)
            self._movers(image, belief.world)
        if belief.plan is not None:
            for candidate in belief.plan.candidates_m:
                self._line(image, candidate, CANDIDATE, 1)
            self._line(image, belief.plan.waypoints_m, PLAN, 1)
        self._line(image, belief.trail_m, TRAIL, 2)
        if belief.path is not None:
            self._line(image, belief.path.xy_m, PATH, 2)
        if belief.plan is not None:
            for point in belief.plan.waypoints_m[1:-1]:
                self._dot(image, point, 3, PLAN)
        self._scan(image, belief)
        self._circle(image, belief.goal, 0.1, GOAL, filled=True)
        self._circle(image, belief.goal, 0.2, GOAL)
        self._robot(image, belief.pose)
        cv2.rectangle(image, (0, 0), (self._size_px - 1, self._size_px - 1), INK, 1)
        return image

    def _ground(self, grid: MapUpdate | None) -> Image:
        image = np.full((self._size_px, self._size_px, 3), UNKNOWN, np.uint8)
        if grid is None:
            return image
        # Look up the cell under each pixel's centre. Pixels outside the grid are unknown.
        corner = self._centre_m - 0.5 * self._size_px / self._scale
        pixel_m = (np.arange(self._size_px) + 0.5) / self._scale
        x, y = (
            np.floor((corner[axis] + pixel_m - grid.origin_m[axis]) / grid.resolution_m).astype(int)
            for axis in (0, 1)
        )
        rows, columns = grid.log_odds.shape
        inside = ((y >= 0) & (y < rows))[:, None] & ((x >= 0) & (x < columns))[None, :]
        cells = grid.log_odds[np.ix_(y.clip(0, rows - 1), x.clip(0, columns - 1))]
        odds = np.where(inside, cells, 0.0)[::-1]
        # The more certain a cell, the nearer its colour is to white (free) or black (occupied).
        sure = np.clip(np.abs(odds) / _SURE_LOG_ODDS, 0.0, 1.0)[..., None]
        ends = np.where(odds[..., None] > 0.0, np.array(INK, float), np.array(PAPER, float))
        return np.ascontiguousarray((image * (1.0 - sure) + ends * sure).astype(np.uint8))

    def _movers(self, image: Image, world: WorldView) -> None:
        """Draw each moving obstacle as a disc with a line to its predicted place in 1 s."""
        if world.movers is None:
            return
        tracks = world.movers
        for place, velocity, radius in zip(
            tracks.position_m, tracks.velocity_mps, tracks.radius_m, strict=True
        ):
            self._circle(image, place, radius, MOVER)
            self._line(image, np.array([place, place + velocity]), MOVER, 2)

    def _scan(self, image: Image, belief: Belief) -> None:
        scan, pose = belief.scan, belief.scan_pose
        if scan is None or pose is None:
            return
        returned = np.isfinite(scan.ranges_m)
        angle, range_m = scan.angles_rad[returned], scan.ranges_m[returned]
        local = range_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) + self._laser_m
        for point in in_map(pose, local):
            self._dot(image, point, 1, SCAN)

    def _robot(self, image: Image, pose: FloatArray) -> None:
        half = 0.5 * np.array([self._vehicle.length_m, self._vehicle.width_m])
        body = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        inner = self._vehicle.gauge_m - 0.5 * self._vehicle.width_m
        for side in (-1.0, 1.0):
            track = np.array([[-half[0], inner], [half[0], inner], half, [-half[0], half[1]]])
            self._polygon(image, in_map(pose, track * [1.0, side]), INK)
        hull = body * [0.88, inner / half[1]]
        self._polygon(image, in_map(pose, hull), (96, 170, 120))
        arrow = np.array([[0.17, 0.0], [-0.05, 0.1], [-0.05, -0.1]])
        self._polygon(image, in_map(pose, arrow), PAPER)

    def _pixels(self, points_m: FloatArray) -> NDArray[np.int32]:
        """Convert points (N, 2) in map, m, to fixed-point pixels (N, 2)."""
        flat = (np.asarray(points_m, float).reshape(-1, 2) - self._centre_m) * [1.0, -1.0]
        pixels = flat * self._scale + 0.5 * self._size_px - 0.5
        return np.round(np.clip(pixels, -1e4, 1e4) * (1 << _SHIFT)).astype(np.int32)

    def _line(self, image: Image, points_m: FloatArray, colour: Colour, width: int) -> None:
        if len(points_m) > 1:
            line = [self._pixels(points_m)[:, None]]
            cv2.polylines(image, line, False, colour, width, cv2.LINE_AA, _SHIFT)

    def _polygon(self, image: Image, points_m: FloatArray, colour: Colour) -> None:
        cv2.fillPoly(image, [self._pixels(points_m)[:, None]], colour, cv2.LINE_AA, _SHIFT)

    def _circle(
        self,
        image: Image,
        centre_m: Sequence[float] | FloatArray,
        radius_m: float,
        colour: Colour,
        filled: bool = False,
    ) -> None:
        centre = self._pixels(np.array(centre_m, float))[0]
        radius = round(radius_m * self._scale * (1 << _SHIFT))
        width = cv2.FILLED if filled else 1
        where = (int(centre[0]), int(centre[1]))
        cv2.circle(image, where, radius, colour, width, cv2.LINE_AA, _SHIFT)

    def _dot(self, image: Image, point_m: FloatArray, radius_px: int, colour: Colour) -> None:
        self._circle(image, point_m, radius_px / self._scale, colour, filled=True)


def in_map(pose: FloatArray, points_m: FloatArray) -> FloatArray:
    """Transform points from a body's frame to map.

    Args:
        pose: (3,) x, y, yaw of the body in map.
        points_m: (N, 2) points in the body's frame, m.

    Returns:
        (N, 2) points in map, m.
    """
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return points_m @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def write_text(
    image: Image, text: str, corner: tuple[int, int], scale: float, colour: Colour = INK
) -> None:
    """Write one line of text into an image.

    Args:
        image: Changed in place.
        text: The text, ASCII.
        corner: x and y of the text's lower left corner, px.
        scale: Size of the letters; 1 is about 20 px.
        colour: Blue, green, red, 0 to 255.
    """
    cv2.putText(image, text, corner, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)
