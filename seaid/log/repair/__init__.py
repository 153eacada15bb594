"""Repair of logged channels: clocks, gaps, wraps of encoders and dropouts."""
