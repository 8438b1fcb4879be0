"""Stages of tasks, found in the rewards of runs: `gril subtasks`."""
