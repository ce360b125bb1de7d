"""Parts that several commands have in common."""
