"""Episodes, rows of results, statistics, the pointing game and failures."""
