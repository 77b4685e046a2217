"""Closed-loop simulation of a tracked ground robot in MuJoCo, headless and reproducible."""
