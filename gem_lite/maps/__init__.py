"""Semantic maps: where the thing that a phrase names lies on the table, by text and by remembered crops."""
