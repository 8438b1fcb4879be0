"""Video files, the colours and shapes in their frames, and pictures drawn from boxes."""
