"""The mapper's settings. None of them belongs to a particular robot, laser or building."""

from __future__ import annotations

from dataclasses import dataclass, field

from simloop.config import SlamConfig


@dataclass(frozen=True, slots=True)
class MappingConfig:
    """Lengths m, angles rad, standard deviations.

    odometry_*: what a step of wheel odometry may be off by: so much at rest, and per metre and
    radian of it. keyframe_*: motion after which a scan enters the map. submap_keyframes: scans of
    a submap; the next begins halfway. cluster_keyframes: scans that are matched as one for a
    closure, one every closure_every keyframes. agreement: the share that surfaces must have among
    the points that meet what the submap knows. sure_window_*: the search's size within which one
    closure suffices; beyond it a second must agree. erring_alike: points of a scan that share the
    error of the surface they meet. rival_score: share of a find's score that no place
    elsewhere may reach. track_agreement: the like in a known map, in which lost_scans in a row
    that agree less mean lost; of the last lookout_keyframes a lost robot makes its picture.
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
    submap_keyframes: int = 40
    closure_every: int = 3
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
