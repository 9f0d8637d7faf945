"""A driver in a car on a road: the demo's input and a test oracle."""
