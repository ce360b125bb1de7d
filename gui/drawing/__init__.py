"""Images of panels and plots, in numpy."""
