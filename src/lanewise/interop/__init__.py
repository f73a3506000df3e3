"""Bridges to other simulators; the only room that imports highway-env."""
