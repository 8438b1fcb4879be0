"""Skills that scripted experts of MAGICAL's tasks share, and how their episodes are chosen."""
