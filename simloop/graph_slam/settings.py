"""Define the settings of the mapper. None is for a particular robot, laser or building."""

from __future__ import annotations

from dataclasses import dataclass, field

from simloop.config import SlamConfig


@dataclass(frozen=True, slots=True)
class MappingConfig:
    """Settings of the mapper, and of localisation in a known map.

    Attributes:
        grid: settings of the occupancy grids.
        range_max_m: longer ranges are ignored.
        odometry_xy_m: standard deviation of an odometry step, constant part, per axis, m.
        odometry_xy_per_m: part that grows with the length of the step, m/m.
        odometry_xy_per_rad: part that grows with the turn of the step, m/rad.
        odometry_yaw_rad: standard deviation of the step's yaw, constant part, rad.
        odometry_yaw_per_m: part that grows with the length of the step, rad/m.
        odometry_yaw_per_rad: part that grows with the turn of the step, rad/rad.
        search_points: most points of a scan that the search uses.
        least_share: least share of a scan's points that must lie on surfaces.
        erring_alike: how many points of a scan share the error of the surface they meet.
        keyframe_m: distance from the last keyframe at which a scan becomes a keyframe.
        keyframe_rad: turn from the last keyframe at which a scan becomes a keyframe.
        submap_m: way in a submap, m; a turn of a radian counts as 1 m. The next submap begins
            halfway.
        closure_m: closures are searched for after so long a way, m; a turn of a radian counts as
            1 m.
        cluster_keyframes: number of keyframes whose scans are joined to search for a closure.
        cluster_points: about how many points such a cluster has.
        closure_least_score: least mean likelihood, 0 to 1, of a closure's points.
        agreement: least share of the points in known cells that must lie on surfaces.
        least_overlap: least share of the points that must lie in known cells.
        sure_window_m: up to this half width of the search window, one match is enough; in a
            larger window, a second match must confirm it.
        most_window_m: largest half width of the search window.
        most_window_rad: the same for the yaw.
        rival_score: no other place may reach this share of the best score.
        track_agreement: like ``agreement``, for a scan in a known map.
        lost_scans: the robot is lost after this many scans in a row that do not fit.
        lookout_keyframes: number of keyframes whose scans a lost robot searches with.
    """

    grid: SlamConfig = field(default_factory=lambda: SlamConfig(match_std_xy_m=0.01))
    range_max_m: float = 30.0
    odometry_xy_m: float = 0.02
    odometry_xy_per_m: float = 0.1
    odometry_xy_per_rad: float = 0.05
    odometry_yaw_rad: float = 0.02
    odometry_yaw_per_m: float = 0.05
    odometry_yaw_per_rad: float = 0.1
    search_points: int = 150
    least_share: float = 0.3
    erring_alike: float = 7.5
    keyframe_m: float = 0.3
    keyframe_rad: float = 0.3
    submap_m: float = 24.0
    closure_m: float = 0.9
    cluster_keyframes: int = 8
    cluster_points: int = 400
    closure_least_score: float = 0.45
    agreement: float = 0.8
    least_overlap: float = 0.5
    sure_window_m: float = 0.6
    most_window_m: float = 8.0
    most_window_rad: float = 0.8
    rival_score: float = 0.85
    track_agreement: float = 0.7
    lost_scans: int = 5
    lookout_keyframes: int = 15
