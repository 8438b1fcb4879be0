"""What is fast: benchmarks, each with its rivals."""
