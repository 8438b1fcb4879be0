"""Learners that the tables compare with: behaviour cloning and GAIL from recorded actions."""
