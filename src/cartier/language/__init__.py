"""Words in, words out: object names, prompts, and what a model replies."""
