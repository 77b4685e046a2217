"""A robot's software in a room of mere kinematics: it moves exactly as it commands."""

from __future__ import annotations

import math

import numpy as np

from helpers.rooms import Room, box
from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.messages import DepthImage, EncoderReading, ImuReading, Readings
from simloop.robot import Mission, Robot

TICK_NS, TICK_S, SCAN_TICKS = 10_000_000, 0.01, 10
READINGS = ("encoders", "imu", "scan", "image")
ROOM = Room(*box(-1.0, -2.0, 4.0, 2.0))


class KinematicRun:
    """Steps a robot; keeps its commands, its messages and where it truly is.

    room: what its scans show; give another one on the way to change the world.
    """

    def __init__(self, goal=(2.5, 0.0), room=ROOM, config=None, start=(0, 0, 0), camera=False):
        self.config, self.room = config or Config(), room
        self.pose = np.array(start, float)
        mission = Mission(self.pose.copy(), np.array(goal, float), 0.1)
        rng = np.random.default_rng(0)
        mount = np.array([0.2, 0.0, 0.16]) if camera else None
        self.robot = Robot(self.config, mission, np.zeros(3), rng, Profiler(), mount, 0.2)
        self.camera = camera
        self.t_ns, self.sprocket, self.velocity = 0, np.zeros(2), (0.0, 0.0)
        self.commands, self.messages = [], []

    def readings(self, scans=True):
        """What perfect sensors say now; the tracks do not slip but in turning, as is expected."""
        counts = np.floor(self.sprocket * self.config.encoder.counts_per_turn / (2 * math.pi))
        encoders = EncoderReading(self.t_ns, *counts.astype(int).tolist())
        accel = np.array([0.0, self.velocity[0] * self.velocity[1], 9.81])
        imu = ImuReading(self.t_ns, np.array([0.0, 0.0, self.velocity[1]]), accel)
        due = self.t_ns // TICK_NS % SCAN_TICKS == 0
        scan = self.room.scan(self.pose, t_ns=self.t_ns) if scans and due else None
        return Readings(encoders, imu, scan, image=self.image() if self.camera and due else None)

    def image(self):
        """A depth image in which nothing is seen."""
        return DepthImage(self.t_ns, np.full((8, 16), np.inf, np.float32), np.full(2, 10.0))

    def step(self, scans=True, **others):
        """One period; others: readings to put in place of the perfect ones."""
        self.t_ns += TICK_NS
        perfect = self.readings(scans)
        given = {name: getattr(perfect, name) for name in READINGS} | others
        command = self.robot.step(Readings(**given))
        self.velocity = (command.speed_mps, command.yaw_rate_radps)
        half = 0.5 * TICK_S * self.velocity[1]
        way = TICK_S * self.velocity[0]
        self.pose += (
            way * math.cos(self.pose[2] + half),
            way * math.sin(self.pose[2] + half),
            2.0 * half,
        )
        self.sprocket += TICK_S * command.sprocket_radps
        self.commands.append(command)
        self.messages += self.robot.messages
        return command

    def run(self, seconds, scans=True):
        for _ in range(round(seconds / TICK_S)):
            self.step(scans)
        return self

    def said(self, kind):
        """The messages of one kind."""
        return [message for message in self.messages if isinstance(message, kind)]
