"""The trap as an environment for other people's agents: Gymnasium, vectorised, and pure JAX."""
