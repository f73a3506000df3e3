"""Test episodes, their metrics with definitions and units, and statistics."""
