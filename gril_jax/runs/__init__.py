"""One run's folder, and the loop that fills it."""
