"""Raw logs to signals to tables on one 10 Hz grid."""
