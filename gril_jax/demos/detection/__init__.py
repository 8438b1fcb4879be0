"""Finds boxes in videos without code of one's own: by words, or by a detector saved as ONNX."""
