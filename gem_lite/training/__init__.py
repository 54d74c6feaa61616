"""Collecting demonstrations, augmentation and training."""
