"""Natural-language understanding without a language model: text, utterances, grounding, answers."""
