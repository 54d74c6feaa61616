"""Rivals of GEM (Sec. 4.1, A.1.5): the same pictures, phrases, augmentation, losses and steps, other networks."""
