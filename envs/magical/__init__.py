"""What MAGICAL's tasks share; one folder a task."""
