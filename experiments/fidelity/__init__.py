"""Whether our physics moves like the original."""
