"""A page in the browser: a sentence in, maps, an action or a refusal out."""
