"""The looks of the simulated world, by name."""

from __future__ import annotations

WORLDS: dict[str, None] = {"home": None}
"""Stub: the real module takes its place."""
