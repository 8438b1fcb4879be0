"""What is seen in a frame: video files, colours, shapes, and pictures drawn from boxes."""
