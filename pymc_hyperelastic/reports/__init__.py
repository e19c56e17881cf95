"""A study as one page that can be read, printed and sent."""
