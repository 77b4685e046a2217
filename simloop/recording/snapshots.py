"""Draw pictures of a run: eight moments with the planner's view, and a sheet of all of them.

After Sabiha 2022, Fig. 19. During the run only references to its read-only messages are kept,
about twice per simulated second. All drawing is done after the run.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np

from simloop.common.files import make_directory, written_together
from simloop.config import VehicleConfig
from simloop.messages import (
    Estimate,
    FloatArray,
    GoalReading,
    LidarScan,
    MapUpdate,
    Plan,
    SmoothPath,
    TrackCommand,
    WorldView,
)
from simloop.recording.belief_picture import PAPER, Belief, Image, PlannerView, write_text
from simloop.recording.offscreen import NoOpenGLError, OffscreenScene
from simloop.truth import LooseTruth, Published, Truth
from simloop.worlds.arena import bounds_of

_log = logging.getLogger(__name__)

_SCENE_PX = (760, 600)
_INSET_PX = 430
_COLUMNS = 4
_MARGIN_PX = 14
_GREY = (110, 104, 98)


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The content of one picture.

    Attributes:
        truth: Ground truth at this instant.
        belief: What the robot believed.
        mode: The driving mode.
        plans: Number of plans so far.
        trail_length: Number of kept true positions before this instant.
        loose: Ground truth of bodies that can move; None if there are none.
    """

    truth: Truth
    belief: Belief
    mode: str
    plans: int
    trail_length: int
    loose: LooseTruth | None


class Snapshots:
    """Listens to a run, and draws pictures of it afterwards.

    Without OpenGL one warning is logged, and only the planner's views are drawn.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        directory: str | Path,
        goal: Sequence[float] | FloatArray,
        vehicle: VehicleConfig | None = None,
        title: str = "",
        moments: int = 8,
        period_s: float = 0.5,
    ) -> None:
        """Prepare to listen.

        Args:
            model: The arena with the vehicle.
            directory: Folder of the pictures; created when they are drawn.
            goal: (2,) goal in map at the start, m.
            vehicle: Size of the vehicle.
            title: Title of the sheet; may be empty.
            moments: Number of pictures.
            period_s: Simulated time between two kept moments.
        """
        self._model, self._directory, self._title = model, Path(directory), title
        self._goal, self._count = np.array(goal[:2], float), moments
        self._vehicle = vehicle if vehicle is not None else VehicleConfig()
        self._period_ns, self._due_ns = round(period_s * 1e9), 0
        self._latest: dict[type, Any] = {}
        self._scan_pose: FloatArray | None = None
        self._plans = 0
        self._truths: list[FloatArray] = []
        self._estimates: list[FloatArray] = []
        self._moments: list[Moment] = []
        self._take: dict[type, Callable[[Any], None]] = {Truth: self._on_truth}
        for kind in (MapUpdate, WorldView, Plan, SmoothPath, TrackCommand, LidarScan, Estimate):
            self._take[kind] = self._keep
        self._take[LooseTruth] = self._take[GoalReading] = self._keep

    def offer(self, message: Published) -> None:
        """Take one message. Kinds that no picture shows are ignored.

        Args:
            message: Any message of the run.
        """
        take = self._take.get(type(message))
        if take is not None:
            take(message)

    def finish(self) -> Path | None:
        """Draw and write ``moment_1.png`` ... and ``contact_sheet.png``.

        Returns:
            The path of the sheet; None if there was no message.

        Raises:
            InputError: A file cannot be written; then there is none of them.
            OSError: A picture cannot be encoded.
        """
        chosen = self.chosen_moments()
        if not chosen:
            return None
        make_directory(self._directory)
        tiles = self._tiles(chosen)
        sheet = self._directory / "contact_sheet.png"
        with written_together() as files:
            for number, tile in enumerate(tiles, start=1):
                files.write_bytes(self._directory / f"moment_{number}.png", _png(tile))
            files.write_bytes(sheet, _png(self._sheet(tiles)))
        return sheet

    def _keep(self, message: Published) -> None:
        self._latest[type(message)] = message
        if isinstance(message, LidarScan):
            self._scan_pose = None
        elif isinstance(message, Estimate) and self._scan_pose is None:
            self._scan_pose = message.pose  # the first estimate that includes the scan's match
        elif isinstance(message, Plan):
            self._plans += 1

    def _on_truth(self, truth: Truth) -> None:
        # The truth starts a control period: a moment shows the state at the end of the last one.
        # The first moment waits for the first map, about 0.1 s.
        last = self._latest.get(Truth)
        waits = MapUpdate not in self._latest and truth.t_ns < self._period_ns
        if last is not None and last.t_ns >= self._due_ns and not waits:
            self._moments.append(self._moment())
            self._due_ns += self._period_ns
        self._latest[Truth] = truth

    def _moment(self) -> Moment:
        """Collect the present state."""
        known, truth = self._latest, self._latest[Truth]
        estimate, command = known.get(Estimate), known.get(TrackCommand)
        goal = known.get(GoalReading)
        pose = truth.pose_xyyaw if estimate is None else estimate.pose
        self._truths.append(truth.position_m)
        self._estimates.append(pose[:2])
        belief = Belief(
            pose,
            self._goal if goal is None else goal.position_m,
            np.array(self._estimates),
            known.get(MapUpdate),
            known.get(WorldView),
            known.get(Plan),
            known.get(SmoothPath),
            known.get(LidarScan),
            self._scan_pose,
        )
        mode = "" if command is None else command.mode
        return Moment(truth, belief, mode, self._plans, len(self._truths), known.get(LooseTruth))

    def chosen_moments(self) -> list[Moment]:
        """Select the moments of the pictures: spread evenly in time, none twice.

        Returns:
            The moments in order, including the first and the present one. Empty before the first
            ground truth.
        """
        if Truth not in self._latest:
            return []
        self._moments.append(self._moment())
        times = np.array([moment.truth.t_ns for moment in self._moments])
        wanted = np.linspace(times[0], times[-1], self._count)
        nearest = {int(np.argmin(np.abs(times - t))) for t in wanted[:-1]} | {len(times) - 1}
        return [self._moments[i] for i in sorted(nearest)]

    def _tiles(self, chosen: list[Moment]) -> list[Image]:
        laser = self._model.site("lidar").pos[:2]
        view = PlannerView(bounds_of(self._model), _INSET_PX, self._vehicle, laser)
        insets = [view.draw(moment.belief) for moment in chosen]
        try:
            with OffscreenScene(self._model, _SCENE_PX) as scene:
                trail = np.array(self._truths)
                scenes = [
                    scene.shoot(
                        m.truth, m.belief.path, trail[: m.trail_length], m.belief.goal, m.loose
                    )
                    for m in chosen
                ]
        except NoOpenGLError as error:
            _log.warning("snapshots without the 3D scene: %s", error)
            return [self._flat_tile(m, inset) for m, inset in zip(chosen, insets, strict=True)]
        return [self._tile(m, s, i) for m, s, i in zip(chosen, scenes, insets, strict=True)]

    def _tile(self, moment: Moment, scene: Image, inset: Image) -> Image:
        """Put the scene at the top, and the planner's view and a caption below it."""
        flat = self._flat_tile(moment, inset)
        tile = np.full((len(scene) + len(flat), scene.shape[1], 3), PAPER, np.uint8)
        tile[: len(scene)], tile[len(scene) :] = scene, flat
        return tile

    def _flat_tile(self, moment: Moment, inset: Image) -> Image:
        tile = np.full((_INSET_PX + 2 * _MARGIN_PX, _SCENE_PX[0], 3), PAPER, np.uint8)
        tile[_MARGIN_PX:-_MARGIN_PX, _MARGIN_PX : _MARGIN_PX + _INSET_PX] = inset
        truth, left = moment.truth, _INSET_PX + 3 * _MARGIN_PX
        to_go = float(np.hypot(*(truth.pose_xyyaw[:2] - moment.belief.goal)))
        write_text(tile, f"{truth.t_ns * 1e-9:.1f} s", (left, 66), 2.0)
        write_text(tile, f"{to_go:.2f} m to go", (left, 124), 1.25)
        small = [f"{abs(truth.velocity_body[0]):.2f} m/s", moment.mode.replace("_", " ")]
        small += [f"plan {moment.plans}"] if moment.plans else []
        for line, text in enumerate(small):
            write_text(tile, text, (left, 180 + 42 * line), 1.0, _GREY)
        return tile

    def _sheet(self, tiles: list[Image]) -> Image:
        height, width = tiles[0].shape[:2]
        columns = min(_COLUMNS, len(tiles))
        rows = -(-len(tiles) // columns)
        gap, head = _MARGIN_PX, 90 if self._title else _MARGIN_PX
        shape = (head + rows * (height + gap), gap + columns * (width + gap), 3)
        sheet = np.full(shape, PAPER, np.uint8)
        if self._title:
            write_text(sheet, self._title, (2 * gap, 60), 1.5)
        for number, tile in enumerate(tiles):
            row, column = divmod(number, columns)
            top, left = head + row * (height + gap), gap + column * (width + gap)
            sheet[top : top + height, left : left + width] = tile
        return sheet


def _png(image: Image) -> bytes:
    done, png = cv2.imencode(".png", image)
    if not done:
        raise OSError("a picture of the run could not be encoded as PNG")
    return bytes(png.tobytes())
