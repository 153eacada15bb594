"""One joint's motor, gear, spring and friction: as data, as equations, as a regressor."""
