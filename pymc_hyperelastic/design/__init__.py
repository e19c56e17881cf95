"""Planned work: what tests would tell, and how large a study must be."""
