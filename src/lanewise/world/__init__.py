"""The road and its traffic, tick by tick; equal to highway-env."""
