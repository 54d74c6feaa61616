"""Episodes, rows of results, statistics."""
