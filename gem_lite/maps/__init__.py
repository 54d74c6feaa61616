"""Semantic maps: where a phrase lies on the table, by text and by remembered crops."""
