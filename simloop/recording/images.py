"""Convert the robot's map and its depth images to images of the recording library."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simloop.mapping.grid_map import GridMap
from simloop.messages import DepthImage, MapUpdate
from simloop.recording.columns import occupancy_percent

if TYPE_CHECKING:
    import rerun as rr

_FARTHEST_M = 3.0


def occupancy(grid: MapUpdate | GridMap, height_m: float) -> rr.GridMap:
    """Convert a map to an image with the grey values of ROS.

    Args:
        grid: The map.
        height_m: Height of the image in the 3D view.

    Returns:
        The library's map.
    """
    import rerun as rr

    rows, columns = grid.log_odds.shape
    return rr.GridMap(
        data=occupancy_percent(grid.log_odds)[
            ::-1
        ].tobytes(),  # the first row of an image is its top
        format=rr.components.ImageFormat(
            width=columns, height=rows, color_model="L", channel_datatype="U8"
        ),
        cell_size=grid.resolution_m,
        translation=[*grid.origin_m, height_m],
        opacity=0.85,
        colormap=rr.components.Colormap.RvizMap,
    )


def pinhole(image: DepthImage) -> rr.Pinhole:
    """Describe the camera's projection, in a frame with x forward, y left, z up.

    Args:
        image: Any image of the camera.

    Returns:
        The library's pinhole camera.
    """
    import rerun as rr

    rows, columns = image.depth_m.shape
    return rr.Pinhole(
        focal_length=image.focal_px,
        width=columns,
        height=rows,
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=0.15,
    )


def depth_columns(images: Sequence[DepthImage]) -> Any:
    """Convert depth images to columns. A pixel without an echo is 0, as in ROS.

    Args:
        images: Images of the same size.

    Returns:
        The library's columns, one row for each image.
    """
    import rerun as rr

    rows, columns = images[0].depth_m.shape
    known = [np.where(np.isfinite(i.depth_m), i.depth_m, np.float32(0.0)) for i in images]
    shape = rr.components.ImageFormat(width=columns, height=rows, channel_datatype="F32")
    return rr.DepthImage.columns(
        buffer=[depth.tobytes() for depth in known],
        format=[shape] * len(images),
        meter=[1.0] * len(images),
        depth_range=[[0.0, _FARTHEST_M]] * len(images),
    )
