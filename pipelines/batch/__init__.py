"""A queue of takes that one machine works through."""
