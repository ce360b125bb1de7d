"""`v3studio compare`: takes measured by one protocol, with pictures side by side."""
