"""Ground truth made by hand."""

from __future__ import annotations

import math

import numpy as np

from simloop.truth import Truth


def truth_at(t_s=0.0, pose=(0.0, 0.0, 0.0), sprocket=(0.0, 0.0), rates=(0.0,) * 6) -> Truth:
    x, y, yaw = pose
    return Truth(
        t_ns=round(t_s * 1e9),
        pose_xyyaw=np.array(pose, float),
        position_m=np.array([x, y, 0.0]),
        quaternion_wxyz=np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]),
        velocity_body=np.array(rates, float),
        acceleration_mps2=np.array([0.0, 0.0, 9.81]),
        sprocket_rad=np.array(sprocket, float),
        sprocket_radps=np.zeros(2),
        motor_current_a=np.zeros(2),
        motor_voltage_v=np.zeros(2),
        energy_j=0.0,
        contact_count=0,
        in_contact=False,
    )
