"""The two sides of the spring: rows of both, estimated one after the other or at once."""
