"""The stages of a task, found in a run's learned reward."""
