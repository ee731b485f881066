"""Parts that several recording formats share: poses, lenses, tables, content checks."""
