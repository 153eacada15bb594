"""Estimators: they read a Regression and know nothing of sides, robots or logs."""
