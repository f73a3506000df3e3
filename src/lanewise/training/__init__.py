"""Recipes of stages as data, and the compiled loop that advances a stage."""
