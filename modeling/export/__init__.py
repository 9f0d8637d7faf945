"""Trained models for other programs: ONNX graphs and C headers, each with its model card."""
