"""CAN logs and databases."""
