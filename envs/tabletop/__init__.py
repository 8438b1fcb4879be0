"""What tasks on a table share; one folder a task."""
