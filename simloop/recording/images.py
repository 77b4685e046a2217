"""What a recording shows as pictures: the robot's map, and what its depth camera sees."""

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
    """A map, grey as in ROS, laid at a height."""
    import rerun as rr

    rows, columns = grid.log_odds.shape
    return rr.GridMap(
        data=occupancy_percent(grid.log_odds)[::-1].tobytes(),  # an image's first row is up
        format=rr.components.ImageFormat(
            width=columns, height=rows, color_model="L", channel_datatype="U8"
        ),
        cell_size=grid.resolution_m,
        translation=[*grid.origin_m, height_m],
        opacity=0.85,
        colormap=rr.components.Colormap.RvizMap,
    )


def pinhole(image: DepthImage) -> rr.Pinhole:
    """How the camera sees, in a frame of x forward, y left, z up."""
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
    """One depth image an instant; what did not come back is 0, as is the custom."""
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
