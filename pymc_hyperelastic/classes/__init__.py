"""Classes of specimens: fitted, stored, and held against new specimens."""
