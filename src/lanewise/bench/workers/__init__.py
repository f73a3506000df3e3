"""Programs that measure one thing each, run by `bench.runner`; some need only a peer."""
