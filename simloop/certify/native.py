"""The same vehicle with MuJoCo's own friction under moving surfaces, for comparison only."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from simloop import track_theory as theory
from simloop.certify.checks import Check, relative
from simloop.certify.rig import Rig
