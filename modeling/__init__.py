"""Mixtures, the drivers' models and their evaluation."""
