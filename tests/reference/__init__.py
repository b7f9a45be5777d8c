"""Small independent implementations and fixtures that tests and benchmarks share."""
