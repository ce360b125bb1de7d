"""Ablation studies: one take per variant, and a comparison of their rate-distortion curves."""
