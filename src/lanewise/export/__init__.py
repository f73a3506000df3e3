"""Trained controllers as files that run without Lanewise: ONNX, and NumPy alone."""
