"""Independent reference implementations and shared inputs of tests and benchmarks."""
