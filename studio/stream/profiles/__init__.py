"""What each profile codes per splat, and with which steps: the definition for the baker and the training losses."""
