"""The dilation of rendered splats: its usual value and bounds, which settings and manifests read without PyTorch."""

DILATION = 0.3
"""The dilation of 3DGS, and of viewers that know no other: added to the diagonal of each 2D covariance, square pixels
of the image that is drawn. It keeps splats about a pixel wide."""

MAX_DILATION = 1.0  # largest dilation that is allowed, square pixels; the smallest is `MIN_DILATION`

MIN_DILATION = 0.001
"""Smallest dilation that is allowed, square pixels. Without any, splats that are thin or far fall between pixels."""
