"""Bodies that can exist: nearest to an estimate, and a prior of what is not told."""
