"""Results on disk: written whole or not at all, checked when read, and parts of long work."""
