"""Measurements of speed and memory, beside the peers that are installed, in one run."""
