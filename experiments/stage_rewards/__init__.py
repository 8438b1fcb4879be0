"""Three ways to get a stage's reward from films, compared."""
