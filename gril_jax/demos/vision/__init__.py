"""Frames: video files, colours and shapes found in them, and pictures drawn from boxes."""
