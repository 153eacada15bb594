"""Readers of log files, one a format: each gives a `Table`, columns loaded when wanted."""
