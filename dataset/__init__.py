"""Synced tables to the per-driver dataset that models are trained on."""
