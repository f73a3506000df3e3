"""Run folders, checkpoints and metrics on disk. Importing it imports nothing else."""
