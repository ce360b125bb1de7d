"""Masks on which all cameras agree; `source` is the loop over the other modules."""
