"""Policies choose actions: GEM, its rivals, their ablations and checkpoints. They do not import a simulator."""
