"""Reinforcement learning with any pure reward, in one compiled step."""
