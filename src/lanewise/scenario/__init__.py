"""Who stands where at the start, who drives how, and what counts as success."""
