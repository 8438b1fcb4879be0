"""The room that MAGICAL's tasks share; one folder a task."""
