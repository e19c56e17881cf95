"""What a posterior says of a tube: curves, elastic properties, stresses."""
