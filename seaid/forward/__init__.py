"""The complete model (7) and (8) forward in time: plant, controller, motor inputs."""
