"""Plane geometry for all other packages."""
