"""Inflation data: units, tables, the labelled Dataset, and what comes with the package."""
