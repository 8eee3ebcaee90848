"""Valid inputs, written by the project's own writers and by ``tests/reference``."""
