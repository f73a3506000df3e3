"""Experiments as data: arms and seeds, run, resumed and read back."""
