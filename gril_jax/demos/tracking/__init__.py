"""Follows objects through a video: identities, gaps, jitter; trackers for videos without boxes."""
