"""What can be measured, a module a part: each says what it measures and lists its tasks."""
