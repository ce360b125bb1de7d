"""The start page: recent takes as cards, the queue of takes, and what can be begun."""
