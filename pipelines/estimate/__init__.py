"""Estimates how long a run will take, and how much memory and disk it needs: `v3studio estimate`."""
