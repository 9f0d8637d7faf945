"""Databases that are shipped: `byd_tang`."""
