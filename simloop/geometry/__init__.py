"""Plane geometry that every other package builds on."""
