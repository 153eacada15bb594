"""Physically consistent inertial parameters: nearest to an estimate and to a prior."""
