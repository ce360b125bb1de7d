"""`v3studio compare`: takes measured by one protocol, with images side by side."""
