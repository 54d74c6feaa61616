"""What chooses actions: GEM, its rivals, their ablations and checkpoints. Nothing here knows a simulator."""
