"""What a setting may hold, what it is called, and what it means. Imports no JAX."""
