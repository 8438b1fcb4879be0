"""Rewards at every level of help that a learner can be given beside the videos."""
