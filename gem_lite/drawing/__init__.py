"""Every drawing, one file for each lesson or subject."""
