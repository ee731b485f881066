"""Language models: prompts, structured output, reply parsing, clients, caches."""
