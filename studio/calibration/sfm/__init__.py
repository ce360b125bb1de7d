"""Structure from motion with COLMAP, in a worker process."""
