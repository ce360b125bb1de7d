"""What must run, in what order; running it, and showing how it goes."""
