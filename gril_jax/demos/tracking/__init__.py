"""Follows objects through a film: identities, gaps, jitter; trackers for films without boxes."""
