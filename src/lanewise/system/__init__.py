"""What the system gives: files, processes, JAX's switches, and what is shown of the progress."""
