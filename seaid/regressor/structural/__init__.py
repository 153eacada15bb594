"""What sensors leave of a robot's equations, and what these can tell: see `seaid.sensors`."""
