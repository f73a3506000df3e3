"""Lanewise: teaching a car to get out of slow traffic with hierarchical reinforcement learning."""

__version__ = "0.1.0"
