"""The task that `gril new-task NAME` writes, and its test; both are read as text."""
