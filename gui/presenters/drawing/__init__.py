"""Drawing into arrays: canvas, lines, plots, colors, splats."""
