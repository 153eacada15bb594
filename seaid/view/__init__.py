"""A look at a robot and its motions in the browser: what there is to see, and a window on it."""
