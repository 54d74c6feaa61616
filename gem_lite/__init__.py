"""gem_lite: Grounded Equivariant Manipulation, small enough to read and good enough to train."""
