"""Ablation studies: one take per variant, and the table that compares them."""
