"""Many homes: recordings mapped by many processes into one store, a catalog of what is in them, and questions."""
