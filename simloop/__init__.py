"""Closed-loop simulation of a tracked ground robot in MuJoCo, headless and reproducible."""

__version__ = "0.1.0"
