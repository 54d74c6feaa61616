"""A policy behind a websocket, for robots whose computer has no torch (the protocol of openpi's client)."""
