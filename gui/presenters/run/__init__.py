"""The take that is open: jobs, settings, exports."""
