"""Readers of log files, one per format: each returns a `Table` that loads columns on demand."""
