"""Benchmarks of speed, each beside other implementations."""
