"""Arrange a recording in the viewer: a large scene, plots beside it, events below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simloop.messages import FloatArray

if TYPE_CHECKING:
    import rerun.blueprint as rrb


def make_blueprint(bounds_m: FloatArray, timeline: str, camera: str | None = None) -> rrb.Blueprint:
    """Arrange the views.

    Args:
        bounds_m: (4,) x_min, y_min, x_max, y_max of the arena in map, m.
        timeline: Name of the timeline.
        camera: Entity of the depth camera; None if there is none.

    Returns:
        The blueprint.
    """
    import rerun.blueprint as rrb

    events: Any = rrb.TextLogView(origin="/events", name="Events")
    if camera is not None:
        sight = rrb.Spatial2DView(origin=f"/{camera}", name="What the depth camera sees")
        events = rrb.Horizontal(sight, events)
    scene = make_scene(bounds_m, "Room, robot and what it knows")
    return arrange(rrb.Vertical(scene, events, row_shares=[4, 1]), _figures(), timeline)


def make_scene(bounds_m: FloatArray, name: str) -> rrb.Spatial3DView:
    """Make the view of what lies below ``map``.

    Args:
        bounds_m: (4,) x_min, y_min, x_max, y_max of what is to be in view, in map, m.
        name: Name of the view.

    Returns:
        The view.
    """
    import rerun.blueprint as rrb

    centre = 0.5 * (bounds_m[:2] + bounds_m[2:])
    span = float(max(bounds_m[2:] - bounds_m[:2]))
    return rrb.Spatial3DView(
        origin="/map",
        name=name,
        background=[250, 250, 250],
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            # From the south and above: the whole arena is in view and y points up.
            position=[centre[0], centre[1] - 1.05 * span, 1.15 * span],
            look_target=[centre[0], centre[1] - 0.05 * span, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def make_plot(name: str, *origins: str) -> rrb.TimeSeriesView:
    """Make the view of some plots.

    Args:
        name: Name of the view.
        origins: Entities below ``plots``.

    Returns:
        The view.
    """
    import rerun.blueprint as rrb

    contents = [f"/plots/{origin}/**" for origin in origins]
    return rrb.TimeSeriesView(origin="/plots", contents=contents, name=name)


def arrange(scene: Any, plots: Any, timeline: str) -> rrb.Blueprint:
    """Put a scene and plots side by side.

    Args:
        scene: View or container on the left.
        plots: View or container on the right.
        timeline: Name of the timeline.

    Returns:
        The blueprint.
    """
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Horizontal(scene, plots, column_shares=[2, 1]),
        rrb.TimePanel(timeline=timeline),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def _figures() -> rrb.Vertical:
    """Arrange the plots, in tabs of related plots."""
    import rerun.blueprint as rrb

    plot = make_plot
    return rrb.Vertical(
        plot("Speed, m/s", "speed"),
        rrb.Tabs(
            plot("Tracks, m/s", "track"),
            plot("Yaw rate, rad/s", "yaw_rate"),
            plot("Currents, A", "current"),
            plot("Voltages, V", "voltage"),
            plot("Energy, J", "energy"),
        ),
        rrb.Tabs(
            plot("Position error, m", "error_position"),
            plot("Yaw error, rad", "error_yaw"),
            plot("NEES", "nees"),
            plot("Filter", "filter"),
            plot("Scan match", "match"),
        ),
        rrb.Tabs(
            plot("Clearance of the path, m", "clearance"),
            plot("Plan's cost", "plan_cost"),
            plot("Plan's effort", "plan_effort"),
        ),
    )
