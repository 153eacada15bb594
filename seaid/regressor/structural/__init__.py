"""Structural identifiability: the parameters that a set of sensors determines, before any log."""
