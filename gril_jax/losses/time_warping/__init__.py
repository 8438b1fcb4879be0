"""Soft-DTW: the problem, its solvers, and the functions that call them."""
