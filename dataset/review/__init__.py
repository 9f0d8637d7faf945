"""The review page: what was proposed beside what the car did, and keys that decide; on this machine only."""

from .server import create_app, serve

__all__ = ["create_app", "serve"]
