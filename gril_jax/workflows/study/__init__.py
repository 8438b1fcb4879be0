"""The frame of every table: rows, training and measuring, resuming, joining, writing."""
