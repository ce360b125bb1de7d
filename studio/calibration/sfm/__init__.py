"""Structure from motion by COLMAP, in a worker process."""
