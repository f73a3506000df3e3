"""Controllers: single-level, planned (step 1) and hierarchical, with goals and the goal critic."""
