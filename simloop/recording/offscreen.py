"""Render MuJoCo scenes without a display."""

from __future__ import annotations

import itertools
import os
from importlib import import_module
from types import TracebackType
from typing import Any

import mujoco
import numpy as np

from simloop.messages import FloatArray, SmoothPath
from simloop.recording.belief_picture import Image
from simloop.truth import LooseTruth, Truth
from simloop.worlds.arena import bounds_of

_PATH_RGBA = (0.12, 0.42, 0.79, 1.0)
_TRAIL_RGBA = (0.24, 0.59, 0.35, 1.0)
_GOAL_RGBA = (0.16, 0.63, 0.27, 1.0)


class NoOpenGLError(RuntimeError):
    """No back end can render off screen. The text names the packages to install."""


class OffscreenScene:
    """Renders an arena with its vehicle off screen. A context manager that holds OpenGL."""

    def __init__(self, model: mujoco.MjModel, size_px: tuple[int, int]) -> None:
        """Store the settings. The ``with`` statement opens OpenGL and may raise NoOpenGLError.

        Args:
            model: The compiled model.
            size_px: Width and height of the images.
        """
        self._model, self._size_px = model, size_px
        self._data = mujoco.MjData(model)

    def __enter__(self) -> OffscreenScene:
        self._gl = open_gl_context(*self._size_px)
        try:
            offscreen = self._model.vis.global_
            offscreen.offwidth, offscreen.offheight = self._size_px
            self._scene = mujoco.MjvScene(self._model, maxgeom=4000)
            self._context = mujoco.MjrContext(
                self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value
            )
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        except mujoco.FatalError as error:
            self._gl.free()
            raise NoOpenGLError(f"OpenGL failed ({error})") from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._context.free()
        self._gl.free()

    def shoot(
        self,
        truth: Truth,
        path: SmoothPath | None,
        trail_m: FloatArray,
        goal: FloatArray,
        loose: LooseTruth | None,
    ) -> Image:
        """Render the scene at one instant.

        Args:
            truth: Ground truth of the vehicle.
            path: The path that the robot follows; None if there is none.
            trail_m: (N, 2) or (N, 3) true positions so far in map, m.
            goal: (2,) goal in map, m.
            loose: Ground truth of the bodies that can move; None if there are none.

        Returns:
            (height, width, 3) uint8 image in OpenCV's colour order, blue first.
        """
        data, model, (width, height) = self._data, self._model, self._size_px
        self._place("base_link", truth.position_m, truth.quaternion_wxyz)
        if loose is not None:
            for name, at, turn in zip(
                loose.bodies, loose.position_m, loose.quaternion_wxyz, strict=True
            ):
                self._place(name, at, turn)
        for name, angle in zip(("left", "right"), truth.sprocket_rad, strict=True):
            data.qpos[model.joint(f"sprocket_{name}_joint").qposadr[0]] = angle
        # Only positions are set, so this computes the poses of all geoms without a time step.
        mujoco.mj_forward(model, data)
        option, perturb = mujoco.MjvOption(), mujoco.MjvPerturb()
        category = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(model, data, option, perturb, self._camera(), category, self._scene)
        # Decorations for this image only. They are not part of the model.
        self._disc(goal, 0.20, 0.002, (1.0, 1.0, 1.0, 1.0))
        self._disc(goal, 0.17, 0.003, _GOAL_RGBA)
        self._ribbon(trail_m[:, :2], 0.006, _TRAIL_RGBA)
        if path is not None:
            self._ribbon(path.xy_m[::4], 0.009, _PATH_RGBA)
        viewport = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(viewport, self._scene, self._context)
        image = np.empty((height, width, 3), np.uint8)
        mujoco.mjr_readPixels(image, None, viewport, self._context)
        # OpenGL counts rows from the bottom and has red first.
        return np.ascontiguousarray(image[::-1, :, ::-1])

    def _place(self, body: str, position_m: FloatArray, quaternion_wxyz: FloatArray) -> None:
        """Set the pose of a free body, or of a mocap body."""
        mocap = self._model.body(body).mocapid[0]
        if mocap >= 0:
            self._data.mocap_pos[mocap] = position_m
            self._data.mocap_quat[mocap] = quaternion_wxyz
            return
        joint = self._model.body(body).jntadr[0]
        at = self._model.jnt_qposadr[joint]
        self._data.qpos[at : at + 3] = position_m
        self._data.qpos[at + 3 : at + 7] = quaternion_wxyz

    def _camera(self) -> mujoco.MjvCamera:
        """Make the arena's own overview camera, or a view of the whole arena from the south."""
        camera = mujoco.MjvCamera()
        overview = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, "overview")
        if overview >= 0:
            camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, overview
            return camera
        bounds = bounds_of(self._model)
        camera.lookat[:2] = 0.5 * (bounds[:2] + bounds[2:])
        camera.distance = 1.6 * float(np.max(bounds[2:] - bounds[:2]))
        camera.azimuth, camera.elevation = 90.0, -55.0
        return camera

    def _geom(self) -> mujoco.MjvGeom | None:
        """Take the next free decoration of the scene; None if there is none left."""
        if self._scene.ngeom >= self._scene.maxgeom:
            return None
        self._scene.ngeom += 1
        return self._scene.geoms[self._scene.ngeom - 1]

    def _disc(
        self, centre: FloatArray, radius: float, height: float, rgba: tuple[float, ...]
    ) -> None:
        geom = self._geom()
        if geom is not None:
            size, where = np.array([radius, height, 0.0]), np.array([*centre, height])
            kind = mujoco.mjtGeom.mjGEOM_CYLINDER
            colour = np.array(rgba, np.float32)
            mujoco.mjv_initGeom(geom, kind, size, where, np.eye(3).ravel(), colour)

    def _ribbon(self, points_m: FloatArray, height: float, rgba: tuple[float, ...]) -> None:
        for start, end in itertools.pairwise(points_m):
            geom = self._geom()
            if geom is None:
                return
            kind = mujoco.mjtGeom.mjGEOM_CAPSULE
            colour = np.array(rgba, np.float32)
            mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), colour)
            ends = np.array([*start, height]), np.array([*end, height])
            mujoco.mjv_connector(geom, kind, 0.016, *ends)


def open_gl_context(width: int, height: int) -> Any:
    """Open an OpenGL context off screen and make it current.

    Args:
        width: Width of the largest image, px.
        height: Height of the largest image, px.

    Returns:
        The context of the back end that MUJOCO_GL names, or of the first one that works.

    Raises:
        NoOpenGLError: No back end works.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    names = [asked] if asked in ("egl", "osmesa", "glfw") else ["egl", "osmesa"]
    if not asked and os.environ.get("DISPLAY"):
        names.append("glfw")
    failures = []
    for name in names:
        platform = os.environ.get("PYOPENGL_PLATFORM")
        try:
            context = import_module(f"mujoco.{name}").GLContext(width, height)
            context.make_current()
            return context
        except Exception as error:  # each back end has its own errors, also while it loads
            failures.append(f"{name}: {' '.join(str(error).split()) or type(error).__name__}")
            if platform is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
    raise NoOpenGLError(
        f"no OpenGL off screen ({'; '.join(failures)}); on Debian: apt-get install libegl1 libgl1"
    )
